//! JSON as a tree of bounded size: lists of numbers are stored compactly, and the number of values is limited.

use std::cell::Cell;
use std::fmt;

use serde::de::{DeserializeSeed, Error, MapAccess, SeqAccess, Visitor};

/// Maximum number of values in a file; 100 000 people with 17 joints have fewer
const MAX_VALUES: usize = 6_000_000;

/// Maximum number of keys that a description lists, and of characters of each
const SHOWN_KEYS: usize = 5;
const SHOWN_CHARS: usize = 40;

/// A JSON value
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Node {
    /// Null, true or false
    Other,
    Number(f64),
    Text(String),
    /// A list of one or more numbers
    Numbers(Vec<f64>),
    /// Any other list
    List(Vec<Node>),
    /// Keys and values in the order of the file
    Object(Vec<(String, Node)>),
}

impl Node {
    /// Parses JSON in UTF-8
    pub(super) fn parse(json: &[u8]) -> Result<Self, serde_json::Error> {
        let left = Cell::new(MAX_VALUES);
        let mut deserializer = serde_json::Deserializer::from_slice(json);
        let node = Reader { left: &left }.deserialize(&mut deserializer)?;
        deserializer.end()?;
        Ok(node)
    }

    /// Returns the value of the first of several keys that an object has
    pub(super) fn get(&self, keys: &[&str]) -> Option<&Node> {
        let Node::Object(fields) = self else {
            return None;
        };
        let of = |key: &&str| fields.iter().find(|(name, _)| name == key);
        keys.iter().find_map(of).map(|(_, value)| value)
    }

    pub(super) fn number(&self) -> Option<f64> {
        match self {
            Node::Number(number) => Some(*number),
            _ => None,
        }
    }

    pub(super) fn is_empty_list(&self) -> bool {
        matches!(self, Node::List(items) if items.is_empty())
    }

    /// Returns the items of a list that contains not only numbers
    pub(super) fn items(&self) -> Option<&[Node]> {
        match self {
            Node::List(items) => Some(items),
            _ => None,
        }
    }

    /// Describes the value for a message, in one line
    pub(super) fn describe(&self) -> String {
        match self {
            Node::Other => "a value that is null, true or false".to_owned(),
            Node::Number(_) => "a single number".to_owned(),
            Node::Text(_) => "a single text".to_owned(),
            Node::Numbers(numbers) => format!("a list of {} numbers", numbers.len()),
            Node::List(items) => describe_list(items),
            Node::Object(fields) => describe_object(fields),
        }
    }
}

/// Describes a list that contains not only numbers
pub(super) fn describe_list(items: &[Node]) -> String {
    let count = items.len();
    match items.first() {
        None => "an empty list".to_owned(),
        Some(first @ Node::List(_)) => format!("a list of {count} lists{}", inner(first)),
        Some(first) => format!("a list of {count}, the first is {}", first.describe()),
    }
}

/// Describes an object by its keys
pub(super) fn describe_object(fields: &[(String, Node)]) -> String {
    if fields.is_empty() {
        return "an object without keys".to_owned();
    }
    let keys = list_keys(fields.iter().map(|(key, _)| key.as_str()));
    format!("an object with {keys}")
}

/// Describes the content of the first list of a list
fn inner(list: &Node) -> String {
    match list.items().and_then(<[Node]>::first) {
        Some(Node::List(_)) | None => String::new(),
        Some(first) => format!(" of {}", first.describe()),
    }
}

/// Lists some keys in quotes, each without line breaks and shortened
pub(super) fn list_keys<'a>(keys: impl ExactSizeIterator<Item = &'a str>) -> String {
    let rest = keys.len().saturating_sub(SHOWN_KEYS);
    let quoted = |key: &str| {
        let mut short: String = key.chars().take(SHOWN_CHARS).collect();
        if short.len() < key.len() {
            short.push_str("...");
        }
        format!("{short:?}")
    };
    let shown: Vec<String> = keys.take(SHOWN_KEYS).map(quoted).collect();
    let more = if rest > 0 {
        format!(" and {rest} more")
    } else {
        String::new()
    };
    format!("{}{more}", shown.join(", "))
}

/// Reads one value and counts it
#[derive(Clone, Copy)]
struct Reader<'a> {
    left: &'a Cell<usize>,
}

impl<'de> DeserializeSeed<'de> for Reader<'_> {
    type Value = Node;

    fn deserialize<D: serde::Deserializer<'de>>(self, deserializer: D) -> Result<Node, D::Error> {
        let left = self.left.get().checked_sub(1);
        let left =
            left.ok_or_else(|| D::Error::custom(format!("more than {MAX_VALUES} values")))?;
        self.left.set(left);
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Reader<'_> {
    type Value = Node;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_unit<E>(self) -> Result<Node, E> {
        Ok(Node::Other)
    }

    fn visit_bool<E>(self, _: bool) -> Result<Node, E> {
        Ok(Node::Other)
    }

    fn visit_i64<E>(self, number: i64) -> Result<Node, E> {
        Ok(Node::Number(number as f64))
    }

    fn visit_u64<E>(self, number: u64) -> Result<Node, E> {
        Ok(Node::Number(number as f64))
    }

    fn visit_f64<E>(self, number: f64) -> Result<Node, E> {
        Ok(Node::Number(number))
    }

    fn visit_str<E>(self, text: &str) -> Result<Node, E> {
        Ok(Node::Text(text.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Node, A::Error> {
        let (mut numbers, mut items) = (Vec::new(), Vec::new());
        while let Some(node) = list.next_element_seed(self)? {
            match node {
                Node::Number(number) if items.is_empty() => numbers.push(number),
                node => {
                    items.extend(numbers.drain(..).map(Node::Number));
                    items.push(node);
                }
            }
        }
        Ok(if numbers.is_empty() {
            Node::List(items)
        } else {
            Node::Numbers(numbers)
        })
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Node, A::Error> {
        let mut fields = Vec::new();
        while let Some(key) = map.next_key::<String>()? {
            fields.push((key, map.next_value_seed(self)?));
        }
        Ok(Node::Object(fields))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(json: &str) -> Node {
        Node::parse(json.as_bytes()).unwrap()
    }

    #[test]
    fn lists_of_numbers_are_compact_and_mixed_lists_keep_their_order() {
        assert_eq!(parse("[1, -2.5]"), Node::Numbers(vec![1.0, -2.5]));
        let mixed = [Node::Number(1.0), Node::Other, Node::Number(2.0)];
        assert_eq!(parse("[1, null, 2]"), Node::List(mixed.to_vec()));
        assert_eq!(parse("[]"), Node::List(vec![]));
        let object = parse(r#"{"b": 1, "a": "x"}"#);
        assert_eq!(object.get(&["c", "a"]), Some(&Node::Text("x".to_owned())));
    }

    #[test]
    fn too_many_values_and_too_deep_lists_are_errors() {
        let many = format!("[{}1]", "1,".repeat(MAX_VALUES));
        let error = Node::parse(many.as_bytes()).unwrap_err().to_string();
        assert!(error.contains("more than 6000000 values"), "{error}");
        assert!(Node::parse("[".repeat(1000).as_bytes()).is_err());
        assert!(Node::parse(b"[1] 2").is_err());
    }

    #[test]
    fn descriptions_are_short_and_have_one_line() {
        let keys: Vec<String> = (0..9)
            .map(|i| format!("\"a\\n{i}{}\":1", "x".repeat(99)))
            .collect();
        let text = parse(&format!("{{{}}}", keys.join(","))).describe();
        assert!(!text.contains('\n') && text.len() < 350, "{text}");
        assert!(text.ends_with("and 4 more"), "{text}");
    }
}
