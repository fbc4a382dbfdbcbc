//! The photos of a keypoint file, and which of them is which photo of a scan.

use std::collections::BTreeMap;
use std::fmt;

use pirouette::scan::KeypointKind;

use super::points::Person;
use super::tree::Node;

/// People of one photo
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Photo {
    /// Name or number of the photo, if the file states one
    pub(super) key: Option<Key>,
    /// Width and height of the image in which the coordinates are px, if the file states them
    pub(super) size_px: Option<(f64, f64)>,
    /// Definition of the joints, if the file names the detector
    pub(super) kind: Option<KeypointKind>,
    pub(super) people: Vec<Person>,
}

impl Photo {
    /// A photo without a key
    pub(super) fn of(people: Vec<Person>) -> Self {
        Self {
            key: None,
            size_px: None,
            kind: None,
            people,
        }
    }
}

/// What a file calls a photo
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Key {
    /// A file name, with or without folders and extension
    Name(String),
    /// The number of a frame or an image id
    Number(i64),
}

impl Key {
    /// Returns the number that the key is
    fn number(&self) -> Option<i64> {
        match self {
            Key::Name(name) => name.parse().ok(),
            Key::Number(number) => Some(*number),
        }
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Key::Name(name) => f.write_str(name),
            Key::Number(number) => write!(f, "{number}"),
        }
    }
}

/// Reads a key from a text or an integer
pub(super) fn key_of_value(node: &Node) -> Option<Key> {
    match node {
        Node::Text(name) => Some(Key::Name(name.clone())),
        Node::Number(number) if number.fract().abs() <= 0.0 => Some(Key::Number(*number as i64)),
        _ => None,
    }
}

/// Returns the index of the key of each photo of a scan; `None` where no key or more than one fits
///
/// Keys fit by the path, the file name or the stem. If none does and all keys are numbers, they fit by the last number in
/// the names, or in the order of the names if there are as many keys as photos and some numbers do not occur: a partial
/// assignment by numbers could be shifted.
pub(super) fn match_photos(keys: &[Option<Key>], photos: &[&str]) -> Vec<Option<usize>> {
    if let ([_], [_]) = (keys, photos) {
        return vec![Some(0)];
    }
    let by_name = match_names(keys, photos);
    if by_name.iter().any(Option::is_some) {
        return by_name;
    }
    let none = vec![None; photos.len()];
    let numbers: Option<Vec<i64>> = keys.iter().map(|key| key.as_ref()?.number()).collect();
    let Some(numbers) = numbers else {
        return none;
    };
    let indices = unique(numbers.iter().copied().enumerate());
    let numbered = |photo: &&str| indices.get(&last_number(photo)?).copied().flatten();
    let by_number: Option<Vec<usize>> = photos.iter().map(numbered).collect();
    let by_number = by_number.or_else(|| in_order(&numbers, photos));
    by_number.map_or(none, |found| found.into_iter().map(Some).collect())
}

/// Returns for each photo the only key that is its path, or else its file name, or else its stem
fn match_names(keys: &[Option<Key>], photos: &[&str]) -> Vec<Option<usize>> {
    let names = || {
        keys.iter()
            .enumerate()
            .filter_map(|(index, key)| match key {
                Some(Key::Name(name)) => Some((index, name.as_str())),
                _ => None,
            })
    };
    let levels: [fn(&str) -> &str; 3] = [|name| name, file_name, stem];
    let indices = levels.map(|part| unique(names().map(|(index, name)| (index, part(name)))));
    let of = |photo: &&str| {
        let found = levels.iter().zip(&indices);
        let first = found
            .into_iter()
            .find_map(|(part, indices)| indices.get(part(photo)));
        first.copied().flatten()
    };
    photos.iter().map(of).collect()
}

/// Returns the index of each value; `None` if it occurs more than once
fn unique<K: Ord>(values: impl Iterator<Item = (usize, K)>) -> BTreeMap<K, Option<usize>> {
    let mut indices = BTreeMap::new();
    for (index, value) in values {
        let first = indices.entry(value).or_insert(Some(index));
        *first = first.filter(|&first| first == index);
    }
    indices
}

fn file_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

/// Returns the file name without its last extension
fn stem(path: &str) -> &str {
    let name = file_name(path);
    match name.rsplit_once('.') {
        Some((stem, _)) if !stem.is_empty() => stem,
        _ => name,
    }
}

/// Returns the last number in the stem of a photo
fn last_number(photo: &str) -> Option<i64> {
    let stem = stem(photo);
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end].rfind(|c: char| !c.is_ascii_digit());
    let start = start.map_or(0, |at| {
        at + stem[at..].chars().next().map_or(1, char::len_utf8)
    });
    stem[start..end].parse().ok()
}

/// Assigns equally many numbers and photos in the order of both
fn in_order(numbers: &[i64], photos: &[&str]) -> Option<Vec<usize>> {
    let sorted = |values: Vec<Option<i64>>| -> Option<Vec<usize>> {
        let values: Vec<i64> = values.into_iter().collect::<Option<_>>()?;
        let mut order: Vec<usize> = (0..values.len()).collect();
        order.sort_by_key(|&index| values[index]);
        let distinct = order
            .windows(2)
            .all(|pair| values[pair[0]] < values[pair[1]]);
        distinct.then_some(order)
    };
    if numbers.len() != photos.len() {
        return None;
    }
    let keys = sorted(numbers.iter().copied().map(Some).collect())?;
    let photos = sorted(photos.iter().map(|photo| last_number(photo)).collect())?;
    let mut found = vec![0; photos.len()];
    for (photo, key) in photos.into_iter().zip(keys) {
        found[photo] = key;
    }
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(names: &[&str]) -> Vec<Option<Key>> {
        let key = |name: &&str| Some(Key::Name((*name).to_owned()));
        names.iter().map(key).collect()
    }

    fn numbers(numbers: &[i64]) -> Vec<Option<Key>> {
        numbers
            .iter()
            .map(|&number| Some(Key::Number(number)))
            .collect()
    }

    #[test]
    fn names_fit_with_and_without_folder_and_extension() {
        let keys = names(&["b.png", "/data/in/a.png", "c"]);
        let photos = ["a.jpg", "b.png", "photos/c.jpg", "d.jpg"];
        assert_eq!(
            match_photos(&keys, &photos),
            [Some(1), Some(0), Some(2), None]
        );
        let twice = names(&["x/a.jpg", "y/a.jpg"]);
        assert_eq!(match_photos(&twice, &["a.jpg", "y/a.jpg"]), [None, Some(1)]);
    }

    #[test]
    fn numbers_fit_the_last_number_of_the_names() {
        let photos = ["img_0.jpg", "img_10.jpg", "img_2.jpg"];
        let found = match_photos(&numbers(&[0, 1, 2, 10]), &photos);
        assert_eq!(found, [Some(0), Some(3), Some(2)]);
        assert_eq!(
            match_photos(&names(&["0", "2", "10"]), &photos),
            [Some(0), Some(2), Some(1)]
        );
    }

    #[test]
    fn equally_many_numbers_fit_in_order_but_fewer_do_not() {
        let photos = ["1.jpg", "2.jpg", "3.jpg"];
        assert_eq!(
            match_photos(&numbers(&[2, 0, 1]), &photos),
            [Some(1), Some(2), Some(0)]
        );
        assert_eq!(match_photos(&numbers(&[0, 1]), &photos), [None; 3]);
        assert_eq!(match_photos(&numbers(&[0, 1, 1]), &photos), [None; 3]);
        assert_eq!(match_photos(&[None, None, None], &photos), [None; 3]);
    }

    #[test]
    fn a_file_with_one_photo_fits_one_photo() {
        assert_eq!(match_photos(&[None], &["a.jpg"]), [Some(0)]);
        assert_eq!(match_photos(&numbers(&[7]), &["a.jpg"]), [Some(0)]);
        assert_eq!(match_photos(&[None], &["a.jpg", "b.jpg"]), [None, None]);
        assert_eq!(last_number("ä5ö12ü.jpg"), Some(12));
        assert_eq!(last_number("99999999999999999999.jpg"), None);
    }
}
