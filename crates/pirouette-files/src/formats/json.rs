//! JSON as people and their programs write it: other encodings, kept shell quotes, comments, commas.
//!
//! [`to_strict`] returns strict JSON unchanged. In other text it fixes what has only one meaning, each character in its
//! place, so that positions in errors are those of the file:
//!
//! - UTF-8 with a byte order mark, and UTF-16 with or without one, as PowerShell 5 writes;
//! - quotes around the complete file, as `cmd` keeps them;
//! - comments (`//`, `/* */`) and trailing commas;
//! - typographic and single quotes, and names without quotes;
//! - decimal commas of values in objects. `1,748` is an error: it means 1748 to some and 1.748 to others.
//!
//! Crates for JSON5 accept comments and trailing commas, but neither these encodings nor shell quotes or decimal commas.

use std::borrow::Cow;
use std::ops::Range;

use serde::de::IgnoredAny;
use thiserror::Error;

/// Why bytes are not JSON; lines and columns are counted from 1, in characters
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum JsonError {
    #[error("the file is empty")]
    Empty,
    #[error("the file is not text in UTF-8 (first invalid byte in line {line}); save it as UTF-8")]
    NotText { line: usize },
    #[error(
        "line {line}, column {column}: `{number}` may mean {thousands} or {decimal}; write one of them"
    )]
    AmbiguousNumber {
        line: usize,
        column: usize,
        number: String,
        thousands: String,
        decimal: String,
    },
    #[error(
        "line {line}, column {column}: `{word}` is not a number in JSON; write a number, for joints that were not found 0, 0, 0"
    )]
    NotFinite {
        line: usize,
        column: usize,
        word: String,
    },
    #[error("not valid JSON in line {line}, column {column}, at `{near}`: {problem}")]
    Syntax {
        line: usize,
        column: usize,
        near: String,
        problem: String,
    },
}

/// Number of characters of the file in an error message
const SHOWN: usize = 24;

/// Quotes that programs substitute for `"` while typing
const DOUBLE_QUOTES: [char; 7] = ['"', '“', '”', '„', '‟', '«', '»'];

/// Quotes around a complete file, or a name in the style of Python
const SINGLE_QUOTES: [char; 3] = ['\'', '‘', '’'];

/// Returns strict JSON in UTF-8 with the meaning of a file
///
/// # Errors
/// When the file is not text, or its meaning is not certain.
pub fn to_strict(bytes: &[u8]) -> Result<Cow<'_, [u8]>, JsonError> {
    let quoted = bytes.trim_ascii_start().first() == Some(&b'"');
    // Of bytes, serde_json would not check the encoding of ignored strings.
    let is_strict = |text: &str| serde_json::from_str::<IgnoredAny>(text).is_ok();
    if !quoted && std::str::from_utf8(bytes).is_ok_and(is_strict) {
        return Ok(Cow::Borrowed(bytes));
    }
    let text: Vec<char> = decode(bytes)?.chars().collect();
    let mut repair = Repair::new(&text);
    let content = repair.content();
    if content.is_empty() {
        return Err(JsonError::Empty);
    }
    repair.run(&content)?;
    match serde_json::from_str::<IgnoredAny>(&repair.out) {
        Ok(_) => Ok(Cow::Owned(repair.out.into_bytes())),
        Err(error) => Err(repair.error(&error)),
    }
}

/// Decodes UTF-8 and UTF-16; the first characters of JSON are ASCII, so that zeros reveal UTF-16 without a mark
fn decode(bytes: &[u8]) -> Result<Cow<'_, str>, JsonError> {
    let big_endian = match bytes {
        [0xfe, 0xff, ..] => Some(true),
        [0xff, 0xfe, ..] => Some(false),
        [0, other, ..] if *other != 0 => Some(true),
        [other, 0, ..] if *other != 0 => Some(false),
        _ => None,
    };
    let Some(big_endian) = big_endian else {
        let text = std::str::from_utf8(bytes).map_err(|error| {
            let valid = bytes.get(..error.valid_up_to()).unwrap_or_default();
            let line = 1 + valid.iter().filter(|&&byte| byte == b'\n').count();
            JsonError::NotText { line }
        })?;
        return Ok(Cow::Borrowed(text.strip_prefix('\u{feff}').unwrap_or(text)));
    };
    let (pairs, rest) = bytes.as_chunks::<2>();
    let units = pairs.iter().map(|&pair| match big_endian {
        true => u16::from_be_bytes(pair),
        false => u16::from_le_bytes(pair),
    });
    let mut text = String::with_capacity(pairs.len());
    for unit in char::decode_utf16(units) {
        let Ok(c) = unit else {
            let line = 1 + text.matches('\n').count();
            return Err(JsonError::NotText { line });
        };
        text.push(c);
    }
    // Half a character at the end is a truncated file.
    if !rest.is_empty() {
        let line = 1 + text.matches('\n').count();
        return Err(JsonError::NotText { line });
    }
    Ok(Cow::Owned(match text.strip_prefix('\u{feff}') {
        Some(text) => text.to_owned(),
        None => text,
    }))
}

/// A file in progress of being fixed
struct Repair<'a> {
    text: &'a [char],
    out: String,
    /// Index into `text` of each byte of `out`
    origins: Vec<usize>,
    /// Opening brackets around the current position
    open: Vec<char>,
    /// Start in `text` of the number that ends at the current position
    number: Option<usize>,
    not_finite: Option<Range<usize>>,
}

impl<'a> Repair<'a> {
    fn new(text: &'a [char]) -> Self {
        Self {
            text,
            out: String::with_capacity(text.len()),
            origins: Vec::with_capacity(text.len()),
            open: Vec::new(),
            number: None,
            not_finite: None,
        }
    }

    /// Returns the range of the text without white space and shell quotes at both ends
    fn content(&self) -> Range<usize> {
        let solid = |c: &char| !c.is_whitespace() && *c != '\0';
        let first = self.text.iter().position(solid).unwrap_or(0);
        let last = self.text.iter().rposition(solid);
        let (Some(last), Some(quote)) = (last, self.text.get(first)) else {
            return 0..0;
        };
        let is_quote = |c: &char| DOUBLE_QUOTES.contains(c) || SINGLE_QUOTES.contains(c);
        let inner = self.text.get(first + 1..last).unwrap_or_default();
        let braced = inner.iter().find(|c| solid(c)) == Some(&'{')
            && inner.iter().rfind(|c| solid(c)) == Some(&'}');
        if braced && is_quote(quote) && self.text.get(last).is_some_and(is_quote) {
            first + 1..last
        } else {
            first..last + 1
        }
    }

    fn at(&self, index: usize) -> char {
        self.text.get(index).copied().unwrap_or('\0')
    }

    fn push(&mut self, c: char, origin: usize) {
        self.out.push(c);
        self.origins.resize(self.out.len(), origin);
    }

    fn run(&mut self, content: &Range<usize>) -> Result<(), JsonError> {
        // `"{ \"key\": 1 }"`: quotes that a shell kept, with those inside escaped for it.
        let escaped = content.start > 0
            && self.at(content.start - 1) == '"'
            && self.text.windows(2).any(|pair| pair == ['\\', '"']);
        let mut index = content.start;
        while index < content.end {
            let c = self.at(index);
            let next = self.at(index + 1);
            if escaped && c == '\\' && next == '"' {
                index = self.string(index + 1, content.end, escaped);
            } else if DOUBLE_QUOTES.contains(&c) || SINGLE_QUOTES.contains(&c) {
                index = self.string(index, content.end, escaped);
            } else if c == '/' && matches!(next, '/' | '*') {
                let end = self.comment_end(index).min(content.end);
                for at in index..end {
                    let c = if self.at(at) == '\n' { '\n' } else { ' ' };
                    self.push(c, at);
                }
                index = end;
            } else if c.is_alphabetic() || c == '_' {
                index = self.word(index);
            } else {
                self.symbol(index)?;
                index += 1;
            }
        }
        Ok(())
    }

    /// Copies a string with plain double quotes; returns the index behind it
    fn string(&mut self, start: usize, end: usize, escaped: bool) -> usize {
        self.number = None;
        let quote = self.at(start);
        let closes = |c: char| match quote {
            '"' => c == '"',
            _ if SINGLE_QUOTES.contains(&quote) => SINGLE_QUOTES.contains(&c),
            _ => DOUBLE_QUOTES.contains(&c),
        };
        self.push('"', start);
        let mut index = start + 1;
        while index < end {
            let c = self.at(index);
            if escaped && c == '\\' && self.at(index + 1) == '"' {
                self.push('"', index);
                return index + 2;
            }
            if closes(c) {
                self.push('"', index);
                return index + 1;
            }
            match c {
                '\\' if self.at(index + 1) == '\'' => self.push('\'', index),
                '\\' => {
                    self.push(c, index);
                    self.push(self.at(index + 1), index + 1);
                }
                '"' => {
                    self.push('\\', index);
                    self.push('"', index);
                }
                c => self.push(c, index),
            }
            index += if c == '\\' { 2 } else { 1 };
        }
        index
    }

    /// Copies a word, in quotes if it is the name of a value; returns the index behind it
    fn word(&mut self, start: usize) -> usize {
        let part = |c: &char| c.is_alphanumeric() || *c == '_';
        let rest = self.text.get(start..).unwrap_or_default();
        let end = start + rest.iter().position(|c| !part(c)).unwrap_or(rest.len());
        let named = self.open.last() == Some(&'{') && self.at(self.solid(end)) == ':';
        let in_number = self.number.is_some();
        let word: String = rest.iter().take(end - start).collect();
        let not_finite = ["nan", "inf", "infinity"].contains(&word.to_lowercase().as_str());
        if not_finite && !named && self.not_finite.is_none() {
            self.not_finite = Some(start..end);
        }
        if named && !in_number {
            self.push('"', start);
        }
        for (offset, c) in word.chars().enumerate() {
            self.push(c, start + offset);
        }
        if named && !in_number {
            self.push('"', end);
        }
        end
    }

    /// Copies a character outside strings, comments and words; fixes commas
    fn symbol(&mut self, index: usize) -> Result<(), JsonError> {
        let c = self.at(index);
        match c {
            '{' | '[' => self.open.push(c),
            '}' | ']' => {
                self.open.pop();
            }
            ',' if matches!(self.at(self.solid(index + 1)), '}' | ']') => {
                self.number = None;
                self.push(' ', index);
                return Ok(());
            }
            ',' if self.is_decimal_comma(index) => {
                self.check_decimal(index)?;
                self.push('.', index);
                return Ok(());
            }
            _ => {}
        }
        let continues = c.is_ascii_digit() || matches!(c, '.' | '-' | '+');
        self.number = continues.then(|| self.number.unwrap_or(index));
        self.push(
            if c.is_whitespace() && c != '\n' {
                ' '
            } else {
                c
            },
            index,
        );
        Ok(())
    }

    /// Returns whether a comma is between digits of one value; in an object, a name must follow any other comma
    fn is_decimal_comma(&self, index: usize) -> bool {
        let (Some(start), Some('{')) = (self.number, self.open.last()) else {
            return false;
        };
        let before = self.text.get(start..index).unwrap_or_default();
        let whole = before.strip_prefix(&['-']).unwrap_or(before);
        let digits = !whole.is_empty() && whole.iter().all(char::is_ascii_digit);
        digits && self.at(index + 1).is_ascii_digit()
    }

    /// Rejects three digits behind a decimal comma, which may be thousands
    fn check_decimal(&self, index: usize) -> Result<(), JsonError> {
        let start = self.number.unwrap_or(index);
        let whole = self.text.get(start..index).unwrap_or_default();
        let rest = self.text.get(index + 1..).unwrap_or_default();
        let decimals = rest.iter().take_while(|c| c.is_ascii_digit());
        let decimals: String = decimals.collect();
        let whole: String = whole.iter().collect();
        let positive = whole.trim_start_matches('-');
        if decimals.len() != 3 || positive.len() > 3 || positive.starts_with('0') {
            return Ok(());
        }
        let (line, column) = self.position(start);
        Err(JsonError::AmbiguousNumber {
            line,
            column,
            number: format!("{whole},{decimals}"),
            thousands: format!("{whole}{decimals}"),
            decimal: format!("{whole}.{decimals}"),
        })
    }

    /// Returns the index of the first character from `index` on that is not white space or in a comment
    fn solid(&self, mut index: usize) -> usize {
        loop {
            let c = self.at(index);
            if c == '/' && matches!(self.at(index + 1), '/' | '*') {
                index = self.comment_end(index);
            } else if c.is_whitespace() {
                index += 1;
            } else {
                return index;
            }
        }
    }

    /// Returns the index behind the comment at `start`
    fn comment_end(&self, start: usize) -> usize {
        let rest = self.text.get(start + 2..).unwrap_or_default();
        let length = if self.at(start + 1) == '/' {
            rest.iter().position(|&c| c == '\n')
        } else {
            let end = rest.windows(2).position(|pair| pair == ['*', '/']);
            end.map(|end| end + 2)
        };
        start + 2 + length.unwrap_or(rest.len())
    }

    /// Returns line and column of a character
    fn position(&self, index: usize) -> (usize, usize) {
        let before = self.text.get(..index).unwrap_or(self.text);
        let line_start = before.iter().rposition(|&c| c == '\n').map_or(0, |i| i + 1);
        let line = 1 + before.iter().filter(|&&c| c == '\n').count();
        (line, before.len() - line_start + 1)
    }

    /// Describes why the fixed text is not JSON
    fn error(&self, error: &serde_json::Error) -> JsonError {
        if let Some(range) = self.not_finite.clone() {
            let (line, column) = self.position(range.start);
            let word = self.text.get(range).unwrap_or_default();
            return JsonError::NotFinite {
                line,
                column,
                word: word.iter().collect(),
            };
        }
        let lines = self.out.split_inclusive('\n');
        let line_start: usize = lines.take(error.line().max(1) - 1).map(str::len).sum();
        let offset = line_start + error.column().saturating_sub(1);
        let end = self.content().end;
        let index = self.origins.get(offset).copied().unwrap_or(end);
        // At the end of the file, its last characters show what is open.
        let index = if error.is_eof() { end } else { index };
        let (line, column) = self.position(index);
        let from = if index < end {
            index
        } else {
            end.saturating_sub(SHOWN / 2)
        };
        let near = self.text.get(from..).unwrap_or_default();
        let near = near.iter().take(SHOWN).take_while(|c| !c.is_control());
        let message = error.to_string();
        let problem = message.split(" at line ").next().unwrap_or_default();
        JsonError::Syntax {
            line,
            column,
            near: near.collect(),
            problem: problem.to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::{Value, json};

    fn read(bytes: &[u8]) -> Result<Value, JsonError> {
        let strict = to_strict(bytes)?;
        Ok(serde_json::from_slice(&strict).expect("the result is strict JSON"))
    }

    fn error(text: &str) -> String {
        read(text.as_bytes()).unwrap_err().to_string()
    }

    fn manifest() -> Value {
        json!({ "subject": { "stature_mm": 1748.5 } })
    }

    const STRICT: &str = r#"{ "subject": { "stature_mm": 1748.5 } }"#;

    #[test]
    fn strict_json_is_not_copied() {
        assert!(matches!(to_strict(STRICT.as_bytes()), Ok(Cow::Borrowed(_))));
    }

    #[test]
    fn encodings_of_windows_are_read() {
        let little: Vec<u8> = STRICT.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = STRICT.encode_utf16().flat_map(u16::to_be_bytes).collect();
        for bytes in [
            [&b"\xef\xbb\xbf"[..], STRICT.as_bytes()].concat(),
            [&b"\xff\xfe"[..], &little].concat(),
            [&b"\xfe\xff"[..], &big].concat(),
            little.clone(),
            big,
        ] {
            assert_eq!(read(&bytes), Ok(manifest()));
        }
        let half = &little[..little.len() - 1];
        assert_eq!(read(half), Err(JsonError::NotText { line: 1 }));
        let latin = b"{ \"a\": 1,\n \"b\": \"M\xfcller\" }";
        assert_eq!(read(latin), Err(JsonError::NotText { line: 2 }));
    }

    #[test]
    fn text_with_one_meaning_is_read() {
        for text in [
            // What `cmd` and `echo` leave of a line for another shell.
            r#"'{ "subject": { "stature_mm": 1748.5 } }' "#,
            r#""{ \"subject\": { \"stature_mm\": 1748.5 } }""#,
            r#""{ "subject": { "stature_mm": 1748.5 } }""#,
            "{ subject: { stature_mm: 1748.5 } }",
            "{ 'subject': { 'stature_mm': 1748.5 } }",
            "{ “subject”: { „stature_mm“: 1748.5 } }",
            "{ «subject»: { ”stature_mm”: 1748.5 } }",
            r#"{ "subject": { "stature_mm": 1748,5 } }"#,
            "{ \"subject\": { \"stature_mm\": 1748.5, }, }",
            "// mine\n{ /* of\n* all */ \"subject\": { \"stature_mm\": 1748.5 /* mm */, // ok\n} }",
            "\u{feff}\u{a0}{\u{a0}\"subject\": { \"stature_mm\": 1748,5 } }\r\n",
        ] {
            assert_eq!(read(text.as_bytes()), Ok(manifest()), "{text}");
        }
    }

    #[test]
    fn strings_keep_what_looks_like_syntax() {
        let text = "{ \"a\": \"// 1,5 ,} 'x' “y”\", 'b': 'say \"it\\'s\"', }";
        let expected = json!({ "a": "// 1,5 ,} 'x' “y”", "b": "say \"it's\"" });
        assert_eq!(read(text.as_bytes()), Ok(expected));
    }

    #[test]
    fn commas_in_lists_separate() {
        let list = read(b"{ \"a\": [1,5, 2,500,] }");
        assert_eq!(list, Ok(json!({ "a": [1, 5, 2, 500] })));
    }

    #[test]
    fn three_digits_behind_a_comma_are_rejected() {
        let message = error("{\n \"a\": 1,748 }");
        for part in ["line 2, column 7", "`1,748`", "1748", "1.748"] {
            assert!(message.contains(part), "{message}");
        }
        assert_eq!(read(b"{ \"a\": 0,748 }"), Ok(json!({ "a": 0.748 })));
        assert_eq!(read(b"{ \"a\": -1748,250 }"), Ok(json!({ "a": -1748.25 })));
    }

    #[test]
    fn errors_show_the_place_in_the_file() {
        let message = error("{ “a”: 1 /* one */ “b”: 2 }");
        assert!(message.contains("line 1, column 20"), "{message}");
        assert!(message.contains("`“b”: 2 }`"), "{message}");
        let message = error("{\n \"a\": { b: 1.748,5 } }");
        assert!(
            message.contains("line 2") && message.contains("`5 } }`"),
            "{message}"
        );
        let message = error("{ \"a\": { \"b\": 1 }");
        assert!(message.contains("\"b\": 1 }`"), "{message}");
        let message = error("{ \"a\": [1, -NaN, nan] }");
        assert!(message.contains("column 13: `NaN`"), "{message}");
        for empty in ["", " \n", "\u{feff}"] {
            assert_eq!(read(empty.as_bytes()), Err(JsonError::Empty));
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_strict_or_an_error_of_one_line(bytes: Vec<u8>) {
            if let Err(error) = read(&bytes) {
                prop_assert!(!error.to_string().contains('\n'));
            }
        }

        #[test]
        fn mutated_text_is_strict_or_an_error_of_one_line(at in 0_usize..60, to in "[\"'“{}\\[\\],:/*.0-9a-z\\\\ \n]{0,3}") {
            let text = "'{ “a”: { b: 1,5, /* c */ 'd': [1, 2,], }, } // e' ";
            let mut chars: Vec<char> = text.chars().collect();
            let at = at.min(chars.len() - 1);
            chars.splice(at..=at, to.chars());
            let text: String = chars.into_iter().collect();
            if let Err(error) = read(text.as_bytes()) {
                prop_assert!(!error.to_string().contains('\n'), "{error}");
            }
        }
    }
}
