//! Small pictures of masks.

use pirouette::scan::Photo;
use pirouette_geom::{Grid, Mask};

const INSIDE: [u8; 3] = [176, 182, 190];
const OUTSIDE: [u8; 3] = [255, 255, 255];
/// Found, but not true
const TOO_MUCH: [u8; 3] = [225, 60, 50];
/// True, but not found
const MISSING: [u8; 3] = [40, 90, 220];

/// Factor by which columns and rows are reduced
const SHRINK: usize = 3;

/// Draws a mask over another one: red for pixels of the first only, blue for pixels of the second only
pub(super) fn difference(found: &Mask, truth: &Mask) -> Photo {
    Grid::from_fn(found.width(), found.height(), |x, y| {
        let of = |mask: &Mask| mask.get(x as isize, y as isize).is_some_and(|&m| m);
        match (of(found), of(truth)) {
            (true, true) => INSIDE,
            (false, false) => OUTSIDE,
            (true, false) => TOO_MUCH,
            (false, true) => MISSING,
        }
    })
}

/// Draws a photo with all pixels outside the mask paled
pub(super) fn cut_out(photo: &Photo, mask: &Mask) -> Photo {
    Grid::from_fn(photo.width(), photo.height(), |x, y| {
        let inside = mask.get(x as isize, y as isize).is_some_and(|&m| m);
        let color = photo[(x, y)];
        if inside {
            color
        } else {
            color.map(|c| 200 + c / 5)
        }
    })
}

/// Arranges pictures in a row, shrunk to a third
///
/// A shrunk pixel is the mean of its colored pixels if there are any, so that these remain visible.
pub(super) fn side_by_side(parts: &[&Photo]) -> Photo {
    let width: usize = parts.iter().map(|p| p.width() / SHRINK).sum();
    let height = parts.iter().map(|p| p.height() / SHRINK).max().unwrap_or(0);
    let mut sheet = Grid::filled(width, height, OUTSIDE);
    let mut left = 0;
    for part in parts {
        for y in 0..part.height() / SHRINK {
            for x in 0..part.width() / SHRINK {
                sheet[(left + x, y)] = shrunk(part, x, y);
            }
        }
        left += part.width() / SHRINK;
    }
    sheet
}

fn shrunk(part: &Photo, x: usize, y: usize) -> [u8; 3] {
    let block =
        (0..SHRINK * SHRINK).map(|i| part[(x * SHRINK + i % SHRINK, y * SHRINK + i / SHRINK)]);
    let marked = |c: &[u8; 3]| *c == TOO_MUCH || *c == MISSING;
    let mut colors: Vec<[u8; 3]> = block.clone().filter(marked).collect();
    if colors.is_empty() {
        colors = block.collect();
    }
    let count = colors.len() as u32;
    std::array::from_fn(|c| {
        let sum: u32 = colors.iter().map(|color| u32::from(color[c])).sum();
        ((sum + count / 2) / count) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_differing_pixels_remain_visible() {
        let truth = Mask::from_art("...... ...... ...###");
        let found = Mask::from_art("...... .#.... ....##");
        let sheet = side_by_side(&[&difference(&found, &truth), &difference(&truth, &truth)]);
        assert_eq!((sheet.width(), sheet.height()), (4, 1));
        assert_eq!(sheet.as_slice()[..2], [TOO_MUCH, MISSING]);
        assert_eq!(sheet[(2, 0)], OUTSIDE);
    }
}
