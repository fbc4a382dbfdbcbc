//! People who are cut off by the border, blur, and masks beside the edges of the photos.

use pirouette_geom::Mask;

use super::median;
use crate::scan::Photo;

/// Minimum extent of a cut along the border, as a share of the photo's height
const MIN_CUT: f64 = 0.006;

/// A border of the photo
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Border {
    /// Cuts off the head
    Top,
    /// Cuts off the feet
    Bottom,
    /// Cuts off arms or hands
    Side,
}

/// Counts the silhouettes that a border of the photo cuts off
pub(crate) fn cut_off_views<'a>(masks: impl Iterator<Item = &'a Mask>, border: Border) -> usize {
    masks.filter(|mask| is_cut_off(mask, border)).count()
}

/// Returns whether a border of the photo cuts off a silhouette
pub(crate) fn is_cut_off(mask: &Mask, border: Border) -> bool {
    let (width, height) = (mask.width(), mask.height());
    if width == 0 || height == 0 {
        return false;
    }
    let row = |y: usize| mask.row(y).iter().filter(|&&inside| inside).count();
    let column = |x: usize| (0..height).filter(|&y| mask[(x, y)]).count();
    let extent = match border {
        Border::Top => row(0),
        Border::Bottom => row(height - 1),
        Border::Side => column(0).max(column(width - 1)),
    };
    extent as f64 > MIN_CUT * height as f64
}

/// Shift of the crown in one view that is not usual, as a share of the height of the person in the photos
///
/// People who turn and sway: up to 0.027. Statures that differ by 70 mm: 0.04.
const MAX_CROWN_SHIFT: f64 = 0.036;

/// Returns the silhouettes whose crown is clearly higher or lower than that of most, by index: another person, or
/// another position of the camera
///
/// Rows are relative to the height of the photo, since photos of one camera may differ in size.
pub(crate) fn other_heights<'a>(masks: impl Iterator<Item = &'a Mask>) -> Vec<usize> {
    let extents: Vec<Option<(f64, f64)>> = masks
        .map(|mask| {
            let height = mask.height() as f64;
            let (_, top, _, bottom) = mask.bounding_box()?;
            Some((top as f64 / height, (bottom - top) as f64 / height))
        })
        .collect();
    let found = || extents.iter().flatten();
    let middle = |of: fn(&(f64, f64)) -> f64| median(&mut found().map(of).collect::<Vec<_>>());
    let (Some(crown), Some(height)) = (middle(|e| e.0), middle(|e| e.1)) else {
        return Vec::new();
    };
    let other = |extent: &Option<(f64, f64)>| {
        extent.is_some_and(|(top, _)| (top - crown).abs() > MAX_CROWN_SHIFT * height)
    };
    (0..extents.len()).filter(|&i| other(&extents[i])).collect()
}

/// Reach of a profile across the outline, in px to each side
const REACH: usize = 7;

/// Minimum difference of the sides of an outline, in gray levels, for its sharpness to be measured
const MIN_CONTRAST: f64 = 40.0;

/// Minimum number of profiles
const MIN_PROFILES: usize = 40;

/// Returns the blur of the outline of a person as the standard deviation of a Gaussian, in px; `None` where too few
/// edges have contrast
///
/// Measured across upright edges, by the ratio of the steepest difference over two pixels to that of the sides; about 1
/// for sharp photos.
pub(crate) fn blur_px(photo: &Photo, mask: &Mask) -> Option<f64> {
    if !photo.same_size(mask) || mask.width() <= 2 * REACH {
        return None;
    }
    let blurs = upright_edges(mask).into_iter();
    typical(
        blurs
            .filter_map(|(x, y)| blur_of_profile(photo, x, y))
            .collect(),
    )
}

/// Returns how far a given mask reaches beyond the edges of the photo, in px; negative if it is too narrow, `None` where
/// too few edges have contrast
///
/// The median, over upright edges, of the position of the steepest difference.
pub(crate) fn excess_px(photo: &Photo, mask: &Mask) -> Option<f64> {
    if !photo.same_size(mask) || mask.width() <= 2 * REACH {
        return None;
    }
    let edges = upright_edges(mask).into_iter();
    let excess = |(x, y): (usize, usize)| {
        let steepest = steepest_of_profile(photo, x, y)?;
        let beyond = x as f64 - steepest;
        // The person is to the right of a left edge.
        Some(if mask[(x, y)] { -beyond } else { beyond })
    };
    typical(edges.filter_map(excess).collect())
}

/// Returns the pixels right of upright edges of a mask that have no other edge within reach in their row
fn upright_edges(mask: &Mask) -> Vec<(usize, usize)> {
    let mut edges = Vec::new();
    for y in (1..mask.height().saturating_sub(1)).step_by(3) {
        let row = mask.row(y);
        for x in REACH..mask.width().saturating_sub(REACH) {
            let clean = |inside: bool| {
                let sides = (&row[x - REACH..x], &row[x..x + REACH]);
                sides.0.iter().all(|&v| v != inside) && sides.1.iter().all(|&v| v == inside)
            };
            let upright = |y: usize| (-2..=2).any(|d| edge_at(mask.row(y), x, d));
            if (clean(true) || clean(false)) && upright(y - 1) && upright(y + 1) {
                edges.push((x, y));
            }
        }
    }
    edges
}

/// Returns the median of a sufficient number of profiles
fn typical(mut values: Vec<f64>) -> Option<f64> {
    (values.len() >= MIN_PROFILES).then(|| median(&mut values))?
}

/// Returns whether a row has an edge near a column
fn edge_at(row: &[bool], x: usize, offset: isize) -> bool {
    let right = x.saturating_add_signed(offset);
    let inside = |x: usize| row.get(x).copied().unwrap_or(false);
    right > 0 && inside(right) != inside(right - 1)
}

/// Gray levels of a row around an edge, and the differences over two pixels
struct Profile {
    contrast: f64,
    slopes: Vec<f64>,
}

/// Returns the profile across the edge before a pixel, if it has contrast
fn profile(photo: &Photo, x: usize, y: usize) -> Option<Profile> {
    let row = photo.row(y);
    let gray = |x: usize| row[x].iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
    let (left, right) = (x - REACH, x + REACH - 1);
    let contrast = (gray(right) - gray(left)).abs();
    let slopes = (left..right - 1)
        .map(|x| (gray(x + 2) - gray(x)).abs())
        .collect();
    (contrast > MIN_CONTRAST).then_some(Profile { contrast, slopes })
}

/// Returns the blur of the edge before a pixel
fn blur_of_profile(photo: &Photo, x: usize, y: usize) -> Option<f64> {
    let profile = profile(photo, x, y)?;
    let steepest = profile.slopes.iter().copied().fold(0.0, f64::max);
    // The slope of a Gaussian edge over two pixels is 2 / (sqrt(2 pi) sigma) of its contrast.
    (steepest > 0.0).then(|| 0.8 * profile.contrast / steepest)
}

/// Returns the column of the edge of the photo near the edge before a pixel, where columns are borders of pixels
///
/// The vertex of the parabola through the steepest difference and its neighbors.
fn steepest_of_profile(photo: &Photo, x: usize, y: usize) -> Option<f64> {
    let slopes = profile(photo, x, y)?.slopes;
    let (at, &steepest) = slopes
        .iter()
        .enumerate()
        .max_by(|a, b| a.1.total_cmp(b.1))?;
    let slope = |at: Option<usize>| at.and_then(|at| slopes.get(at)).copied().unwrap_or(0.0);
    let [before, after] = [at.checked_sub(1), Some(at + 1)].map(slope);
    let curvature = before + after - 2.0 * steepest;
    let offset = if curvature < 0.0 {
        (before - after) / (2.0 * curvature)
    } else {
        0.0
    };
    // The difference of pixels k and k + 2 is centered on pixel k + 1.
    Some((x - REACH + at) as f64 + 1.5 + offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the silhouette of a person whose crown is in a row of a photo of 100 rows
    fn standing(crown: usize) -> Mask {
        Mask::from_fn(40, 100, |x, y| {
            (15..25).contains(&x) && (crown..90).contains(&y)
        })
    }

    #[test]
    fn a_mask_is_compared_with_the_edges_of_the_photo_to_fractions_of_a_pixel() {
        // A bright column from 29.7 to 60.3 before a dark wall; pixels at its borders mix both.
        let covered = |x: f64| {
            (60.3 - x)
                .clamp(0.0, 1.0)
                .min((x + 1.0 - 29.7).clamp(0.0, 1.0))
        };
        let photo = Photo::from_fn(90, 200, |x, _| {
            [(40.0 + 160.0 * covered(x as f64)).round() as u8; 3]
        });
        for (first, end, expected) in [(30, 60, -0.3), (29, 61, 0.7), (31, 59, -1.3), (27, 63, 2.7)]
        {
            let mask = Mask::from_fn(90, 200, |x, _| (first..end).contains(&x));
            let excess = excess_px(&photo, &mask).unwrap();
            assert!((excess - expected).abs() < 0.1, "{first}..{end}: {excess}");
        }
    }

    #[test]
    fn a_higher_crown_in_one_view_is_another_height_and_sway_is_not() {
        let others = |crowns: &[usize]| {
            let masks: Vec<Mask> = crowns.iter().map(|&crown| standing(crown)).collect();
            other_heights(masks.iter())
        };
        assert!(others(&[10, 11, 9, 10, 12, 10]).is_empty());
        assert_eq!(others(&[10, 11, 6, 10, 10, 14]), [2, 5]);
        assert!(others(&[]).is_empty());
    }
}
