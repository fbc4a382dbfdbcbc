//! Rough silhouettes: what differs from the color that most photos have in common.

use pirouette_geom::morphology::{close, components, fill_holes_below, open};
use pirouette_geom::parallel::prelude::*;
use pirouette_geom::{Grid, Mask};

use super::palette::Palette;
use crate::scan::Photo;

/// Longer side of the images that are compared, in px; averaging suppresses noise
const WORK_SIDE_PX: usize = 400;

/// Maximum number of photos that determine the background; the time grows with its square
const MAX_BACKGROUND_VIEWS: usize = 16;

/// Colors that differ by less are equal, in levels
const SAME_COLOR: f32 = 7.0;

/// Colors that differ by more from the background belong to the person, in levels
pub(super) const OTHER_COLOR: f32 = 9.0;

/// Weight of brightness relative to hue: shadows change brightness
const BRIGHTNESS_WEIGHT: f32 = 0.6;

/// Radius of the smallest structure that is no noise, and of the largest gap in the person, in px
const NOISE_RADIUS_PX: f64 = 1.0;
const GAP_RADIUS_PX: f64 = 4.0;

/// Parts of the person that are separated from the largest one have at least this share of its area
const MIN_PART: f64 = 0.02;

/// Colors of a photo, averaged over square blocks: brightness, blue and red difference
pub(super) type Blocks = Grid<[f32; 3]>;

/// Returns the side of the blocks for photos of a size, in px
pub(super) fn block_side(photo: &Photo) -> usize {
    photo
        .width()
        .max(photo.height())
        .div_ceil(WORK_SIDE_PX)
        .max(1)
}

/// Averages a photo over square blocks; incomplete ones at the right and at the bottom are left out
pub(super) fn blocks(photo: &Photo, side: usize) -> Blocks {
    let (width, height) = (photo.width() / side, photo.height() / side);
    let area = (side * side) as f32;
    let mut sums = Grid::filled(width, height, [0.0_f32; 3]);
    for y in 0..height * side {
        let row = &photo.row(y)[..width * side];
        for (sum, block) in sums
            .row_mut(y / side)
            .iter_mut()
            .zip(row.chunks_exact(side))
        {
            for pixel in block {
                for (s, &channel) in sum.iter_mut().zip(pixel) {
                    *s += f32::from(channel);
                }
            }
        }
    }
    sums.map(|sum| {
        let [r, g, b] = sum.map(|s| s / area);
        let brightness = 0.299 * r + 0.587 * g + 0.114 * b;
        [
            BRIGHTNESS_WEIGHT * brightness,
            0.564 * (b - brightness),
            0.713 * (r - brightness),
        ]
    })
}

pub(super) fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let square: f32 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    square.sqrt()
}

/// An estimate of a silhouette
#[derive(Debug)]
pub(super) struct Estimate {
    pub(super) inside: Mask,
    /// The estimate, dilated by its usual error: background outside is certain
    pub(super) hidden: Mask,
    /// The estimate, dilated by its largest error
    pub(super) near: Mask,
}

/// Color of the background at each pixel; `None` where no view shows it
pub(super) type Background = Grid<Option<[f32; 3]>>;

/// Returns how many colors are equal to a color
pub(super) fn votes(colors: &[[f32; 3]], color: [f32; 3]) -> usize {
    let equal = colors.iter().filter(|&&c| distance(c, color) < SAME_COLOR);
    equal.count()
}

/// How the votes of the views for a color of the background are weighted
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Votes {
    /// The color that most views show
    Plain,
    /// The color that most views show, if it is usual in the background where most views agree: what clothes of one color hide
    /// in most views is found, but shadows count as the person
    ByPalette,
}

/// Returns at each pixel the color that most views agree on, the first of equals; only views count in which it
/// is certainly not hidden
pub(super) fn common_background(
    views: &[Blocks],
    figures: Option<&[Estimate]>,
    weight: Votes,
) -> Option<Background> {
    let first = views.first()?;
    let (width, height) = (first.width(), first.height());
    let step = views.len().div_ceil(MAX_BACKGROUND_VIEWS);
    let used: Vec<&Blocks> = views.iter().step_by(step).collect();
    let palette = (weight == Votes::ByPalette).then(|| Palette::new(&used));
    let share = |color: [f32; 3]| {
        palette
            .as_ref()
            .map_or(1.0, |palette| palette.background_share(color))
    };
    let rows = (0..height).into_par_iter().map(|y| {
        let mut colors: Vec<[f32; 3]> = Vec::with_capacity(views.len());
        let color = |x: usize| {
            colors.clear();
            let shown = |view: &usize| figures.is_none_or(|figures| !figures[*view].hidden[(x, y)]);
            let shown = (0..views.len()).step_by(step).filter(shown);
            colors.extend(shown.map(|view| views[view][(x, y)]));
            let scored = |&color: &[f32; 3]| (votes(&colors, color) as f32 * share(color), color);
            // `max_by` returns the last of equal maxima, so the order is reversed.
            let best = colors.iter().map(scored).rev();
            let best = best.max_by(|(a, _), (b, _)| a.total_cmp(b));
            best.map(|(_, color)| color)
        };
        (0..width).map(color).collect::<Vec<_>>()
    });
    let rows: Vec<Vec<Option<[f32; 3]>>> = rows.collect();
    Some(Grid::from_vec(width, height, rows.concat()))
}

/// Returns a background with the exposure of a view, most of which shows the background
///
/// Automatic exposure differs between an empty room and one with a person.
pub(super) fn as_exposed(background: &Background, view: &Blocks) -> Background {
    let shift: [f32; 3] = std::array::from_fn(|channel| {
        let pairs = view.as_slice().iter().zip(background.as_slice());
        let differences =
            pairs.filter_map(|(seen, known)| Some(seen[channel] - (*known)?[channel]));
        let mut differences: Vec<f32> = differences.collect();
        let middle = differences.len() / 2;
        match differences.is_empty() {
            true => 0.0,
            false => *differences.select_nth_unstable_by(middle, f32::total_cmp).1,
        }
    });
    let shifted = |color: [f32; 3]| std::array::from_fn(|channel| color[channel] + shift[channel]);
    background.map(|color| color.map(shifted))
}

/// Returns the silhouette of what differs from the background; empty if nothing does
///
/// `figure` is an estimate of the silhouette: what lies far outside is not the person, and where the background is
/// unknown, it decides.
pub(super) fn rough_silhouette(
    view: &Blocks,
    background: &Background,
    figure: Option<&Estimate>,
) -> Mask {
    let differs = Mask::from_fn(view.width(), view.height(), |x, y| {
        let color = view[(x, y)];
        let other = |background: [f32; 3]| distance(color, background) > OTHER_COLOR;
        let near = figure.is_none_or(|figure| figure.near[(x, y)]);
        let inside = || figure.is_some_and(|figure| figure.inside[(x, y)]);
        near && background[(x, y)].map_or_else(inside, other)
    });
    let closed = close(&open(&differs, NOISE_RADIUS_PX), GAP_RADIUS_PX);
    let parts = match figure {
        Some(_) => closed,
        None => large_parts(&closed),
    };
    fill_holes_below(&parts, usize::MAX)
}

/// Keeps the largest component and the large ones above or below it
fn large_parts(mask: &Mask) -> Mask {
    let parts = components(mask);
    let Some(largest) = parts.largest() else {
        return mask.clone();
    };
    let mut kept = parts.mask(largest);
    let Some((left, _, right, _)) = kept.bounding_box() else {
        return kept;
    };
    for (part, &area) in parts.areas.iter().enumerate() {
        if part == largest || (area as f64) < MIN_PART * parts.areas[largest] as f64 {
            continue;
        }
        let other = parts.mask(part);
        let above = other
            .bounding_box()
            .is_some_and(|(x0, _, x1, _)| x0 < right && x1 > left);
        if above {
            let both = kept.as_mut_slice().iter_mut().zip(other.as_slice());
            both.for_each(|(kept, &other)| *kept |= other);
        }
    }
    kept
}
