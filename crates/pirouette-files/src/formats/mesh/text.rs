//! Words and numbers of text files, with line numbers.

use std::fmt::Write;

use super::{Place, ReadMeshError};

/// The lines of a text file that contain more than white space and comments, each split into words
#[derive(Debug, Clone)]
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    /// Number of the last line read, from 1
    line: usize,
}

/// One line, split into words
#[derive(Debug, Clone)]
pub(super) struct Words<'a> {
    rest: &'a [u8],
    pub(super) place: Place,
}

impl<'a> Lines<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self {
            // Editors of Windows mark UTF-8.
            rest: bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes),
            line: 0,
        }
    }

    /// Returns the next line with a word; `None` at the end
    pub(super) fn next(&mut self) -> Option<Words<'a>> {
        while !self.rest.is_empty() {
            // Lines end with LF, CR LF, or only CR.
            let end = self.rest.iter().position(|b| matches!(b, b'\n' | b'\r'));
            let (line, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
            let rest = rest.strip_prefix(b"\r").unwrap_or(rest);
            self.rest = rest.strip_prefix(b"\n").unwrap_or(rest);
            self.line += 1;
            let comment = line.iter().position(|&b| b == b'#').unwrap_or(line.len());
            let line = line[..comment].trim_ascii();
            if !line.is_empty() {
                return Some(Words::new(line, Place::Line(self.line)));
            }
        }
        None
    }

    /// Returns the next line with a word, or an error that names what is missing
    pub(super) fn expect(&mut self, expected: &'static str) -> Result<Words<'a>, ReadMeshError> {
        self.next().ok_or_else(|| self.ended(expected))
    }

    /// Returns the error for something that is missing after the last line read
    pub(super) fn ended(&self, expected: &'static str) -> ReadMeshError {
        ReadMeshError::Ended {
            place: Place::Line(self.line),
            expected,
        }
    }
}

impl<'a> Words<'a> {
    pub(super) fn new(line: &'a [u8], place: Place) -> Self {
        Self { rest: line, place }
    }

    /// Returns the next word of the line; `None` at its end
    pub(super) fn next(&mut self) -> Option<&'a [u8]> {
        let line = self.rest.trim_ascii_start();
        let end = line.iter().position(u8::is_ascii_whitespace);
        let (word, rest) = line.split_at(end.unwrap_or(line.len()));
        self.rest = rest;
        (!word.is_empty()).then_some(word)
    }

    /// Skips a number of bytes at the start of the next word
    pub(super) fn skip(&mut self, count: usize) {
        let line = self.rest.trim_ascii_start();
        self.rest = line.get(count..).unwrap_or_default();
    }

    /// Returns whether another word follows
    pub(super) fn more(&self) -> bool {
        !self.rest.trim_ascii_start().is_empty()
    }

    /// Returns the next word, or an error that names what is missing
    pub(super) fn expect(&mut self, expected: &'static str) -> Result<&'a [u8], ReadMeshError> {
        let place = self.place;
        self.next().ok_or(ReadMeshError::Unexpected {
            place,
            expected,
            found: "end of the line".to_owned(),
        })
    }

    /// Parses the next word as a finite number
    pub(super) fn number(&mut self) -> Result<f64, ReadMeshError> {
        const EXPECTED: &str = "a finite number";
        let word = self.expect(EXPECTED)?;
        parse::<f64>(word)
            .filter(|value| value.is_finite())
            .ok_or_else(|| unexpected(self.place, EXPECTED, word))
    }

    /// Parses the next word as an integer
    pub(super) fn integer(&mut self) -> Result<i64, ReadMeshError> {
        const EXPECTED: &str = "an integer";
        let word = self.expect(EXPECTED)?;
        parse(word).ok_or_else(|| unexpected(self.place, EXPECTED, word))
    }

    /// Parses the next word as a count
    pub(super) fn count(&mut self) -> Result<u64, ReadMeshError> {
        const EXPECTED: &str = "a count";
        let word = self.expect(EXPECTED)?;
        parse(word).ok_or_else(|| unexpected(self.place, EXPECTED, word))
    }
}

/// Parses a complete word as a value
pub(super) fn parse<T: std::str::FromStr>(word: &[u8]) -> Option<T> {
    std::str::from_utf8(word).ok()?.parse().ok()
}

/// Returns the error for an unexpected word
pub(super) fn unexpected(place: Place, expected: &'static str, found: &[u8]) -> ReadMeshError {
    const SHOWN_BYTES: usize = 40;
    let shown = &found[..found.len().min(SHOWN_BYTES)];
    ReadMeshError::Unexpected {
        place,
        expected,
        found: String::from_utf8_lossy(shown).into_owned(),
    }
}

/// Writes a number in the fewest digits that parse to the same value
pub(super) fn push_number(text: &mut String, value: f64) {
    let magnitude = value.abs();
    // Outside this range, plain notation would have more zeros than digits.
    let written = if magnitude == 0.0 || (1e-5..1e17).contains(&magnitude) {
        write!(text, "{value}")
    } else {
        write!(text, "{value:e}")
    };
    written.expect("writing to a string cannot fail");
}

/// Writes three numbers separated by blanks
pub(super) fn push_point(text: &mut String, point: glam::DVec3) {
    for (k, value) in point.to_array().into_iter().enumerate() {
        if k > 0 {
            text.push(' ');
        }
        push_number(text, value);
    }
}
