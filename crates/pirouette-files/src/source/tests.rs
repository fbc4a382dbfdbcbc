use std::io::{Cursor, Write};

use proptest::prelude::*;
use zip::write::{SimpleFileOptions, ZipWriter};

use super::*;

const DEFLATE: zip::CompressionMethod = zip::CompressionMethod::Deflated;

fn zipped(write: impl FnOnce(&mut ZipWriter<Cursor<Vec<u8>>>)) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    write(&mut writer);
    writer.finish().unwrap().into_inner()
}

fn zip_of(files: &[(&str, &[u8])]) -> Vec<u8> {
    zipped(|writer| {
        let options = SimpleFileOptions::default().compression_method(DEFLATE);
        for (name, bytes) in files {
            writer.start_file(*name, options).unwrap();
            writer.write_all(bytes).unwrap();
        }
    })
}

fn open(bytes: Vec<u8>) -> Result<Source, SourceError> {
    Source::from_zip("anna.zip", bytes)
}

#[track_caller]
fn rejected(bytes: Vec<u8>) -> String {
    open(bytes).unwrap_err().to_string()
}

fn sorted_names(source: &Source) -> Vec<String> {
    let mut names = source.names().unwrap();
    names.sort();
    names
}

/// Replaces each occurrence of a byte sequence by another of the same length
fn patched(mut bytes: Vec<u8>, from: &[u8], to: &[u8]) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let mut found = 0;
    for at in 0..=bytes.len() - from.len() {
        if bytes[at..].starts_with(from) {
            bytes[at..at + to.len()].copy_from_slice(to);
            found += 1;
        }
    }
    assert!(found > 0, "{from:?}");
    bytes
}

#[test]
fn memory_zip_and_folder_list_and_read_the_same_files() {
    let files: [(&str, &[u8]); 4] = [
        ("000.jpg", b"photo"),
        ("keypoints/000_keypoints.json", b"[]"),
        ("scan.json", b"{}"),
        ("views/000/view.json", b"{}"),
    ];
    // Files at the top and in its folders, but not in folders of those
    let listed = ["000.jpg", "keypoints/000_keypoints.json", "scan.json"];
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("keypoints")).unwrap();
    std::fs::create_dir_all(folder.path().join("views/000")).unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let on_disk = folder.path().join("anna.zip");
    let sources = [
        Source::from_files("anna", files).unwrap(),
        open(zip_of(&files)).unwrap(),
        Source::open(folder.path()).unwrap(),
        {
            std::fs::write(&on_disk, zip_of(&files)).unwrap();
            let source = Source::open(&on_disk).unwrap();
            std::fs::remove_file(&on_disk).unwrap();
            source
        },
    ];
    for source in &sources {
        assert_eq!(sorted_names(source), listed, "{source:?}");
        for (name, bytes) in files {
            assert!(source.contains(name) && source.is_inside(name));
            assert_eq!(&*source.read(name, 5).unwrap(), bytes);
        }
        let kind = |name, limit| source.read(name, limit).unwrap_err().kind();
        assert_eq!(kind("000.jpg", 4), io::ErrorKind::FileTooLarge);
        assert_eq!(kind("001.jpg", 4), io::ErrorKind::NotFound);
        assert_eq!(&*source.read("./000.jpg", 5).unwrap(), b"photo");
    }
    assert_eq!(sources[0].title(), "anna");
    assert_eq!(sources[1].title(), "anna");
    assert_eq!(sources[3].title(), "anna");
}

#[test]
fn a_single_top_folder_is_stripped_and_desktop_metadata_is_ignored() {
    let source = open(zip_of(&[
        ("anna/000.jpg", b"photo"),
        ("anna/keypoints/000_keypoints.json", b"{}"),
        ("anna/.DS_Store", b"x"),
        ("__MACOSX/anna/._000.jpg", b"x"),
        (".DS_Store", b"x"),
    ]))
    .unwrap();
    let names = ["000.jpg", "keypoints/000_keypoints.json"];
    assert_eq!(sorted_names(&source), names);
    let two = open(zip_of(&[("anna/000.jpg", b""), ("bert/000.jpg", b"")])).unwrap();
    assert_eq!(sorted_names(&two), ["anna/000.jpg", "bert/000.jpg"]);
}

#[test]
fn names_that_point_outside_the_scan_are_rejected() {
    for name in [
        "../a.jpg",
        "a/../../b.jpg",
        "/etc/passwd",
        "a\\b.jpg",
        "C:/a.jpg",
        "a\0.jpg",
        "..",
    ] {
        let message = rejected(zip_of(&[("000.jpg", b"photo"), (name, b"x")]));
        assert!(message.contains("points outside the scan"), "{message}");
        let memory = Source::from_files("anna", [(name, b"x".to_vec())]);
        assert!(matches!(memory, Err(SourceError::NameLeaves { .. })));
    }
    assert!(stays_inside("a/b.jpg") && stays_inside("./a") && stays_inside("a..b"));
    assert!(!stays_inside("") && !stays_inside("."));
}

#[test]
fn links_duplicates_and_encrypted_files_are_rejected() {
    let link = zipped(|writer| {
        let options = SimpleFileOptions::default();
        writer
            .add_symlink("000.jpg", "/etc/passwd", options)
            .unwrap();
    });
    assert!(rejected(link).contains("000.jpg is a link"));
    let twins = patched(
        zip_of(&[("a.jpg", b"1"), ("b.jpg", b"2")]),
        b"b.jpg",
        b"a.jpg",
    );
    assert!(rejected(twins).contains("twice"));
    assert!(rejected(zip_of(&[("a.jpg", b"1"), ("./a.jpg", b"2")])).contains("a.jpg occurs twice"));
    assert!(Source::from_files("anna", [("a", [1]), ("./a", [2])]).is_err());
    // The encryption flag in the local and the central header of the single entry
    let mut secret = zip_of(&[("a.jpg", b"1")]);
    let central = secret.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
    secret[6] |= 1;
    secret[central + 8] |= 1;
    assert!(rejected(secret).contains("a.jpg is encrypted"));
    let mut other = zip_of(&[("a.jpg", b"1")]);
    other[8] = 14;
    other[central + 10] = 14;
    let message = rejected(other);
    assert!(message.contains("a.jpg is compressed by"), "{message}");
}

#[test]
fn zip_bombs_are_rejected() {
    let zeros = vec![0; (1 << 20) + 1];
    let message = rejected(zip_of(&[("0.jpg", &zeros)]));
    assert!(message.contains("times larger uncompressed"), "{message}");
    let many = zipped(|writer| {
        for index in 0..=MAX_ENTRY_COUNT {
            let options = SimpleFileOptions::default();
            writer.start_file(index.to_string(), options).unwrap();
        }
    });
    assert!(rejected(many).contains("10001 files"));
    // Sizes claimed by the central headers
    let claims = |bytes: u32, entries: usize| {
        let names: Vec<String> = (0..entries).map(|i| format!("{i}.jpg")).collect();
        let files: Vec<(&str, &[u8])> = names.iter().map(|n| (&n[..], &b"x"[..])).collect();
        let mut zip = zip_of(&files);
        for at in 0..zip.len() - 4 {
            if zip[at..].starts_with(b"PK\x01\x02") {
                zip[at + 20..at + 24].copy_from_slice(&bytes.to_le_bytes());
                zip[at + 24..at + 28].copy_from_slice(&bytes.to_le_bytes());
            }
        }
        zip
    };
    assert!(rejected(claims(600 << 20, 1)).contains("0.jpg has 629145600 bytes"));
    assert!(rejected(claims(500 << 20, 9)).contains("more than 4294967296 bytes"));
}

#[test]
fn reading_fails_if_a_header_claims_a_wrong_size() {
    let content = vec![7; 5000];
    for claimed in [4999_u32, 5001] {
        let mut zip = zip_of(&[("a.jpg", &content)]);
        let central = zip.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
        zip[central + 24..central + 28].copy_from_slice(&claimed.to_le_bytes());
        // The archive reports a larger file itself; a smaller one is detected here.
        let error = open(zip).unwrap().read("a.jpg", 1 << 20).unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("uncompressed size") || message.contains("stated in its header"),
            "{message}"
        );
    }
}

#[test]
fn files_that_are_not_zip_files_are_reported() {
    for bytes in [&b""[..], b"PK", b"\x89PNG\r\n\x1a\n....", b"Rar!\x1a\x07"] {
        assert!(rejected(bytes.to_vec()).contains("neither a folder nor a zip file"));
    }
    let complete = zip_of(&[("a.jpg", b"photo")]);
    for length in 4..complete.len() {
        let message = rejected(complete[..length].to_vec());
        assert!(message.contains("damaged zip file"), "{message}");
    }
}

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let mut zip = b"PK\x03\x04".to_vec();
        zip.extend(&bytes);
        prop_assert!(open(bytes).is_err());
        prop_assert!(open(zip).is_err());
    }

    #[test]
    fn changed_bits_never_panic(flips in prop::collection::vec((any::<prop::sample::Index>(), 0..8_u8), 1..4)) {
        let content: Vec<u8> = (0..2000_u32).map(|i| (i * i / 7) as u8).collect();
        let mut zip = zip_of(&[("anna/000.jpg", &content), ("anna/scan.json", b"{ }")]);
        for (at, bit) in flips {
            let at = at.index(zip.len());
            zip[at] ^= 1 << bit;
        }
        if let Ok(source) = open(zip) {
            for name in source.names().unwrap() {
                if let Ok(bytes) = source.read(&name, 1 << 20) {
                    prop_assert!(bytes.len() <= 1 << 20);
                }
            }
        }
    }
}
