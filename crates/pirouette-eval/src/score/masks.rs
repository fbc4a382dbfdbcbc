//! Overlap of masks.

use pirouette_geom::Mask;

/// Range of the first search for the best shift in both directions, in px of the halved mask
const REACH_PX: isize = 24;

/// Step of the first search; each further search halves it
const FIRST_STEP_PX: isize = 16;

/// Returns a mask of half the size; pixels of which at least half is inside are foreground
pub fn halved(mask: &Mask) -> Mask {
    let (width, height) = (mask.width().div_ceil(2), mask.height().div_ceil(2));
    Mask::from_fn(width, height, |x, y| {
        let mut inside = 0;
        let mut count = 0;
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            if let Some(&value) = mask.get((2 * x + dx) as isize, (2 * y + dy) as isize) {
                count += 1;
                inside += usize::from(value);
            }
        }
        2 * inside >= count
    })
}

/// Computes the mean overlap (intersection over union) of pairs, the first of each moved by one common best shift
///
/// The search is coarse to fine, not exhaustive. Pairs of different sizes have an overlap of 0; `None` without pairs.
pub fn best_shift_iou(pairs: &[(Mask, Mask)]) -> Option<f64> {
    if pairs.is_empty() {
        return None;
    }
    let score = |dx: isize, dy: isize| {
        let all: f64 = pairs.iter().map(|(a, b)| shifted_iou(a, b, dx, dy)).sum();
        all / pairs.len() as f64
    };
    let (mut best, mut place) = (-1.0, (0, 0));
    let (mut reach, mut step) = (REACH_PX, FIRST_STEP_PX);
    while step >= 1 {
        let near = place;
        for dx in (-reach..=reach).step_by(step as usize) {
            for dy in (-reach..=reach).step_by(step as usize) {
                let (dx, dy) = (near.0 + dx, near.1 + dy);
                let found = score(dx, dy);
                if found > best {
                    (best, place) = (found, (dx, dy));
                }
            }
        }
        (reach, step) = (step, step / 2);
    }
    Some(best)
}

/// Computes the overlap of a mask, shifted by integer pixels and clipped, with another one
fn shifted_iou(moved: &Mask, other: &Mask, dx: isize, dy: isize) -> f64 {
    if !moved.same_size(other) {
        return 0.0;
    }
    let (width, height) = (moved.width() as isize, moved.height() as isize);
    let (mut both, mut left) = (0, 0);
    let columns = dx.max(0)..(width + dx).min(width);
    for y in dy.max(0)..(height + dy).min(height) {
        if columns.is_empty() {
            break;
        }
        let from = (columns.start - dx) as usize..(columns.end - dx) as usize;
        let a = &moved.row((y - dy) as usize)[from];
        let b = &other.row(y as usize)[columns.start as usize..columns.end as usize];
        for (&a, &b) in a.iter().zip(b) {
            both += u32::from(a & b);
            left += u32::from(a);
        }
    }
    let either = left + other.area() as u32 - both;
    f64::from(both) / f64::from(either.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spot(width: usize, x0: usize, y0: usize) -> Mask {
        Mask::from_fn(width, 80, |x, y| {
            (x0..x0 + 20).contains(&x) && (y0..y0 + 30).contains(&y)
        })
    }

    #[test]
    fn at_least_two_of_four_pixels_make_one() {
        let mask = Mask::from_art("##.#.. .....#");
        assert_eq!(halved(&mask).to_art(), Mask::from_art("#..").to_art());
    }

    #[test]
    fn a_moved_mask_overlaps_completely() {
        let pair = (spot(90, 30, 20), spot(90, 41, 13));
        assert_eq!(best_shift_iou(&[pair]), Some(1.0));
    }

    #[test]
    fn one_shift_for_two_pairs_is_a_compromise() {
        let pairs = [
            (spot(90, 30, 20), spot(90, 35, 20)),
            (spot(90, 30, 20), spot(90, 25, 20)),
        ];
        // Either one pair completely and the other by a half (10 of 30 columns), or both by 15 of 25.
        let iou = best_shift_iou(&pairs).unwrap();
        assert!((iou - (1.0 + 10.0 / 30.0) / 2.0).abs() < 1e-9, "{iou}");
    }

    #[test]
    fn pixels_shifted_out_of_the_picture_are_clipped() {
        let mask = Mask::from_art("##. ##.");
        let moved = Mask::from_art("..# ..#");
        assert_eq!(shifted_iou(&mask, &moved, 2, 0), 1.0);
        assert_eq!(shifted_iou(&mask, &moved, 9, 0), 0.0);
        assert_eq!(shifted_iou(&mask, &Mask::from_art("##"), 0, 0), 0.0);
    }
}
