//! Golden pictures: what a rendering looked like when someone last looked at it.

use std::path::Path;

use pirouette::geom::Mask;
use pirouette::io::photo::{decode_mask, encode_mask};

/// Set to 1, golden files are written anew instead of compared; review the difference
const REGENERATE: &str = "REGENERATE";

/// Compares a mask with a PNG file; at most `tolerated_px` pixels may differ
///
/// # Panics
/// When they differ by more, or the file cannot be read; then the mask is drawn coarsely into the message.
pub fn assert_mask(file: &Path, mask: &Mask, tolerated_px: usize) {
    if std::env::var(REGENERATE).is_ok_and(|v| v == "1") {
        let png = encode_mask(mask).expect("a mask with pixels is a PNG file");
        std::fs::write(file, png).expect("golden files can be written");
        return;
    }
    let bytes = std::fs::read(file)
        .unwrap_or_else(|error| panic!("{}: {error}; set {REGENERATE}=1", file.display()));
    let golden = decode_mask(&bytes).expect("golden files are PNG files");
    assert!(
        golden.same_size(mask),
        "{}: {golden:?} became {mask:?}",
        file.display()
    );
    let pairs = golden.as_slice().iter().zip(mask.as_slice());
    let different = pairs.filter(|(a, b)| a != b).count();
    assert!(
        different <= tolerated_px,
        "{}: {different} px differ, {tolerated_px} may (set {REGENERATE}=1 after a look):\n{}",
        file.display(),
        difference_art(&golden, mask)
    );
}

/// Columns of a drawn difference
const ART_COLUMNS: usize = 72;

/// Both masks drawn over each other, shrunk: `#` both, `+` only the new one, `-` only the golden one
fn difference_art(golden: &Mask, mask: &Mask) -> String {
    let step = golden.width().div_ceil(ART_COLUMNS).max(1);
    let mut art = String::new();
    // Characters are twice as high as wide.
    for y0 in (0..golden.height()).step_by(2 * step) {
        for x0 in (0..golden.width()).step_by(step) {
            let (mut gained, mut lost, mut both) = (false, false, false);
            for y in y0..(y0 + 2 * step).min(golden.height()) {
                for x in x0..(x0 + step).min(golden.width()) {
                    match (golden[(x, y)], mask[(x, y)]) {
                        (true, true) => both = true,
                        (true, false) => lost = true,
                        (false, true) => gained = true,
                        (false, false) => {}
                    }
                }
            }
            art.push(match (gained, lost, both) {
                (true, true, _) => '*',
                (true, false, _) => '+',
                (false, true, _) => '-',
                (false, false, true) => '#',
                (false, false, false) => '.',
            });
        }
        art.push('\n');
    }
    art
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_drawn() {
        let golden = Mask::from_art("##. ##. #.. #..");
        let mask = Mask::from_art("##. ##. ..# ..#");
        assert_eq!(difference_art(&golden, &mask), "##.\n-.+\n");
    }

    #[test]
    fn as_many_pixels_as_tolerated_may_differ() {
        let folder = tempfile::tempdir().expect("temporary folders can be made");
        let file = folder.path().join("golden.png");
        let golden = encode_mask(&Mask::from_art("##. #..")).expect("it has pixels");
        std::fs::write(&file, golden).expect("it can be written");
        assert_mask(&file, &Mask::from_art("#.. #.."), 1);
        let other = Mask::from_art("... #..");
        assert!(std::panic::catch_unwind(|| assert_mask(&file, &other, 1)).is_err());
    }
}
