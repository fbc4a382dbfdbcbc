//! Conversion from the centers of border pixels to the border between pixels.

use glam::DVec2;

use super::Contour;

/// Moves a border that runs through pixel centers outward by half a pixel
///
/// The border must come from [`super::trace_contours`]. Outward is away from the inside, so outer contours grow and
/// holes shrink. One-pixel bridges, followed on both sides, become one pixel wide, and a single pixel a diamond. Where
/// the border is concave, the result overlaps itself; fill it by nonzero winding.
///
/// Half a pixel is measured along x or y, whichever the border faces more: slanted borders move by less, like the
/// stairs of their pixels. The enclosed area is that of the pixels, except for an eighth of a pixel per corner.
///
/// # Examples
/// ```
/// use pirouette_geom::{Mask, contour::{trace_contours, widen_border}};
/// let block = &trace_contours(&Mask::from_art("..... .###. .###. ....."))[0];
/// assert_eq!(block.signed_area(), 2.0);
/// assert_eq!(widen_border(block).signed_area(), 6.0 - 4.0 / 8.0);
/// ```
pub fn widen_border(border: &Contour) -> Contour {
    let points = match border.points.as_slice() {
        &[lone] => (0..4).map(|corner| lone + diamond(2 * corner)).collect(),
        points => sweep(points),
    };
    Contour {
        points,
        hole: border.hole,
    }
}

/// Moves a diamond of radius one half along the border and follows its outermost corner
///
/// Directions count eighths of a turn. Corners of the diamond face even directions; where the border faces an odd
/// direction, two corners are outermost and the earlier one counts.
fn sweep(centers: &[DVec2]) -> Vec<DVec2> {
    let count = centers.len();
    let facing = |i: usize| {
        let step = centers[(i + 1) % count] - centers[i];
        // the outward direction of a step to the right is up on screen
        let outward = DVec2::new(step.y, -step.x);
        (outward.to_angle() / std::f64::consts::FRAC_PI_4).round() as i32
    };
    let mut points = Vec::with_capacity(count * 2);
    for (i, &center) in centers.iter().enumerate() {
        let before = facing((i + count - 1) % count);
        let mut turn = (facing(i) - before).rem_euclid(8);
        // Reversals occur at the tips of one-pixel bridges, which the diamond passes on the outside.
        if turn > 4 {
            turn -= 8;
        }
        let (first, last) = (even(before), even(before + turn));
        let corners = (last - first).abs() / 2;
        for k in 0..=corners {
            points.push(center + diamond(first + 2 * k * (last - first).signum()));
        }
    }
    points
}

/// Returns the even direction at or before this one
fn even(direction: i32) -> i32 {
    direction - direction.rem_euclid(2)
}

/// Returns the corner of the diamond that faces an even direction
fn diamond(direction: i32) -> DVec2 {
    match direction.rem_euclid(8) {
        0 => DVec2::new(0.5, 0.0),
        2 => DVec2::new(0.0, 0.5),
        4 => DVec2::new(-0.5, 0.0),
        _ => DVec2::new(0.0, -0.5),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contour::{trace_contours, trace_outline};
    use crate::coverage::fill_polygons;
    use crate::{Grid, Mask};
    use proptest::prelude::*;

    fn widened(mask: &Mask) -> Vec<Vec<DVec2>> {
        let borders = trace_contours(mask);
        borders.iter().map(|b| widen_border(b).points).collect()
    }

    fn coverage(mask: &Mask, loops: &[Vec<DVec2>]) -> Grid<f32> {
        fill_polygons(mask.width(), mask.height(), loops)
    }

    #[test]
    fn a_bridge_becomes_one_pixel_wide() {
        let mask = Mask::from_art("......... .##....#. .#######. .##....#. .........");
        let filled = coverage(&mask, &widened(&mask));
        assert!((filled[(4, 2)] - 1.0).abs() < 1e-6);
        assert!(filled[(4, 1)].abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn widened_borders_are_the_outline_between_the_pixels(
            bits in prop::collection::vec(prop::bool::weighted(0.6), 10 * 10),
        ) {
            let mask = Mask::from_vec(10, 10, bits);
            let outline = trace_outline(&mask.map(|&v| f32::from(u8::from(v))), 0.5);
            let outline: Vec<_> = outline.into_iter().map(|c| c.points).collect();
            let (a, b) = (coverage(&mask, &widened(&mask)), coverage(&mask, &outline));
            for (a, b) in a.as_slice().iter().zip(b.as_slice()) {
                prop_assert!((a - b).abs() < 0.01, "{a} {b}");
            }
        }
    }
}
