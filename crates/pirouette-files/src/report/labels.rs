//! Placement of labels without overlap: columns of labels, and legends with line breaks.

use pirouette::scan::Photo;

use super::canvas::{Color, tint_box};
use super::font::Lettering;

/// The rectangle of pixels of one label
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct LabelBox {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) width: usize,
    pub(super) height: usize,
}

/// Computes the first rows of labels in one column, in the given order and without overlap, near the wanted rows
///
/// Minimizes the sum of squared distances from `wanted` for labels with the given `heights`, within the rows from 0 to
/// `space`. Values that are not finite are treated as row 0. Labels that do not fit into the space together continue
/// below it.
///
/// # Source
/// After subtracting the heights of the labels above, first rows must not decrease: isotonic regression, solved by
/// pooling adjacent violators (Barlow et al. 1972, Statistical Inference under Order Restrictions, section 1.2). The
/// limits on the rows clamp its solution.
pub(super) fn spread(wanted: &[f64], heights: &[usize], space: usize) -> Vec<usize> {
    let mut above = 0;
    let mut offsets = Vec::with_capacity(heights.len());
    // Mean and size of each pool of adjacent labels
    let mut pools: Vec<(f64, usize)> = Vec::new();
    for (&row, &height) in wanted.iter().zip(heights) {
        let row = if row.is_finite() { row } else { 0.0 };
        let mut pool = (row - above as f64, 1);
        while let Some(&(mean, size)) = pools.last().filter(|last| last.0 > pool.0) {
            let total = mean * size as f64 + pool.0 * pool.1 as f64;
            pool = (total / (size + pool.1) as f64, size + pool.1);
            pools.pop();
        }
        pools.push(pool);
        offsets.push(above);
        above += height;
    }
    let room = space.saturating_sub(above) as f64;
    let rows = pools
        .into_iter()
        .flat_map(|(mean, size)| std::iter::repeat_n(mean, size));
    rows.zip(offsets)
        .map(|(row, offset)| row.clamp(0.0, room).round() as usize + offset)
        .collect()
}

/// Mark in front of the text of a legend's entry
#[derive(Debug, Clone)]
pub(super) enum Mark {
    /// No mark
    None,
    /// A sample of one color
    Swatch(Color),
    /// A scale of colors
    Bar(Vec<Color>),
}

/// An explanation of a color
#[derive(Debug, Clone)]
pub(super) struct Entry {
    pub(super) mark: Mark,
    pub(super) text: String,
}

impl Entry {
    pub(super) fn swatch(color: Color, text: &str) -> Self {
        Self {
            mark: Mark::Swatch(color),
            text: text.to_owned(),
        }
    }

    pub(super) fn plain(text: &str) -> Self {
        Self {
            mark: Mark::None,
            text: text.to_owned(),
        }
    }
}

/// Positioned entries, each in a separate box
pub(super) struct Legend {
    entries: Vec<(LabelBox, Entry)>,
    /// Columns and rows of the legend
    pub(super) size: (usize, usize),
}

/// Columns of one color of a bar, relative to the size of the text
const BAR_STEP: f64 = 0.6;

/// Space between entries, relative to the size of the text
const ENTRY_GAP: f64 = 1.3;

/// Space between a mark and its text, relative to the size of the text
const MARK_GAP: f64 = 0.45;

/// Color of the line around a mark
const FRAME: Color = [110, 116, 126];

impl Legend {
    /// Arranges entries in lines no wider than `width_px`; each group starts a line
    ///
    /// Texts wider than a line are shortened.
    pub(super) fn new(groups: Vec<Vec<Entry>>, lettering: &mut Lettering, width_px: usize) -> Self {
        let height = lettering.line_px();
        let gap = (lettering.size_px() * ENTRY_GAP) as usize;
        let mut entries = Vec::new();
        let (mut widest, mut top) = (0, 0);
        for group in groups {
            let mut left = 0;
            for mut entry in group {
                let indent = text_indent(&entry.mark, lettering);
                entry.text = lettering.shortened(&entry.text, width_px.saturating_sub(indent));
                let width = (indent + lettering.width(&entry.text)).min(width_px);
                if left > 0 && left + width > width_px {
                    (left, top) = (0, top + height);
                }
                let place = LabelBox {
                    left,
                    top,
                    width,
                    height,
                };
                widest = widest.max(left + width);
                left += width + gap;
                entries.push((place, entry));
            }
            top += height;
        }
        Self {
            entries,
            size: (widest, top),
        }
    }

    /// Draws the entries, with the upper left corner of the legend at `(left, top)`
    pub(super) fn draw(
        &self,
        photo: &mut Photo,
        (left, top): (usize, usize),
        lettering: &mut Lettering,
        ink: Color,
    ) {
        let (capitals, capital_height) = lettering.capitals_px();
        for (place, entry) in &self.entries {
            let (left, top) = (left + place.left, top + place.top);
            let width = mark_width(&entry.mark, lettering).min(place.width);
            let corner = (left, top + capitals);
            match &entry.mark {
                Mark::None => {}
                Mark::Swatch(color) => {
                    framed(photo, corner, (width, capital_height), &[*color]);
                }
                Mark::Bar(colors) => framed(photo, corner, (width, capital_height), colors),
            }
            let text_left = left + text_indent(&entry.mark, lettering);
            lettering.draw(photo, (text_left, top), &entry.text, ink);
        }
    }
}

/// Returns the columns of a mark
fn mark_width(mark: &Mark, lettering: &Lettering) -> usize {
    match mark {
        Mark::None => 0,
        Mark::Swatch(_) => lettering.size_px() as usize,
        Mark::Bar(colors) => colors.len() * ((lettering.size_px() * BAR_STEP) as usize).max(1) + 2,
    }
}

/// Returns the columns of a mark and of the space after it
fn text_indent(mark: &Mark, lettering: &Lettering) -> usize {
    match mark_width(mark, lettering) {
        0 => 0,
        width => width + (lettering.size_px() * MARK_GAP) as usize,
    }
}

/// Fills a box with stripes of equal width, with a line around them
fn framed(
    photo: &mut Photo,
    (left, top): (usize, usize),
    (width, height): (usize, usize),
    colors: &[Color],
) {
    tint_box(photo, (left, top), (width, height), FRAME, 1.0);
    let inner = width.saturating_sub(2);
    for (i, &color) in colors.iter().enumerate() {
        let start = i * inner / colors.len();
        let stripe = (i + 1) * inner / colors.len() - start;
        let corner = (left + 1 + start, top + 1);
        tint_box(
            photo,
            corner,
            (stripe, height.saturating_sub(2)),
            color,
            1.0,
        );
    }
}

/// Space between the texts of a title, relative to the size of the text
const TITLE_GAP: f64 = 0.6;

/// Draws the title of a tile within its width: a name, shortened if necessary, then a note in a paler color
pub(super) fn title(
    sheet: &mut Photo,
    (left, top): (usize, usize),
    width_px: usize,
    lettering: &mut Lettering,
    (name, ink): (&str, Color),
    (note, note_ink): (&str, Color),
) {
    let note = lettering.shortened(note, width_px);
    let gap = (lettering.size_px() * TITLE_GAP) as usize;
    let taken = match lettering.width(&note) {
        0 => 0,
        width => width + gap,
    };
    let name = lettering.shortened(name, width_px.saturating_sub(taken));
    lettering.draw(sheet, (left, top), &name, ink);
    let after = match lettering.width(&name) {
        0 => 0,
        width => width + gap,
    };
    lettering.draw(sheet, (left + after, top), &note, note_ink);
}

/// Returns the columns of a title whose texts are not shortened
pub(super) fn title_width(name: &str, note: &str, lettering: &mut Lettering) -> usize {
    let gap = (lettering.size_px() * TITLE_GAP) as usize;
    let widths = [lettering.width(name), lettering.width(note)];
    match widths {
        [0, width] | [width, 0] => width,
        [name, note] => name + gap + note,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn intersect(a: &LabelBox, b: &LabelBox) -> bool {
        let apart =
            |a: usize, a_size: usize, b: usize, b_size: usize| a + a_size <= b || b + b_size <= a;
        !apart(a.left, a.width, b.left, b.width) && !apart(a.top, a.height, b.top, b.height)
    }

    #[test]
    fn labels_with_enough_space_are_placed_as_wanted() {
        assert_eq!(spread(&[5.0, 40.0, 80.4], &[20; 3], 200), [5, 40, 80]);
        assert_eq!(spread(&[], &[], 200), [0; 0]);
    }

    #[test]
    fn labels_wanted_at_one_row_spread_in_both_directions() {
        assert_eq!(spread(&[100.0; 3], &[20; 3], 200), [80, 100, 120]);
        assert_eq!(spread(&[0.0; 3], &[20; 3], 200), [0, 20, 40]);
        assert_eq!(spread(&[999.0; 3], &[20; 3], 200), [140, 160, 180]);
    }

    proptest! {
        #[test]
        fn labels_of_a_column_never_overlap(
            labels in prop::collection::vec((-100.0..1300.0f64, 1..60usize), 0..24),
            extra in 0..800usize,
            poison in prop::option::of(prop::sample::select(vec![f64::NAN, f64::INFINITY])),
        ) {
            let mut wanted: Vec<f64> = labels.iter().map(|l| l.0).collect();
            wanted.sort_by(f64::total_cmp);
            if let (Some(first), Some(poison)) = (wanted.first_mut(), poison) {
                *first = poison;
            }
            let heights: Vec<usize> = labels.iter().map(|l| l.1).collect();
            let space = heights.iter().sum::<usize>() + extra;
            let tops = spread(&wanted, &heights, space);
            prop_assert_eq!(tops.len(), heights.len());
            let boxes: Vec<LabelBox> = tops
                .iter()
                .zip(&heights)
                .map(|(&top, &height)| LabelBox { left: 0, top, width: 9, height })
                .collect();
            for pair in boxes.windows(2) {
                prop_assert!(pair[0].top + pair[0].height <= pair[1].top);
            }
            prop_assert!(boxes.iter().all(|b| b.top + b.height <= space));
        }

        #[test]
        fn no_other_rows_are_closer(
            labels in prop::collection::vec((0.0..300.0f64, 1..40usize), 1..10),
            shifts in prop::collection::vec(-5..6i64, 10),
        ) {
            let mut wanted: Vec<f64> = labels.iter().map(|l| l.0).collect();
            wanted.sort_by(f64::total_cmp);
            let heights: Vec<usize> = labels.iter().map(|l| l.1).collect();
            let space = heights.iter().sum::<usize>() + 50;
            let cost = |tops: &[i64]| -> f64 {
                tops.iter().zip(&wanted).map(|(&top, w)| (top as f64 - w).powi(2)).sum()
            };
            let tops: Vec<i64> = spread(&wanted, &heights, space).iter().map(|&t| t as i64).collect();
            let other: Vec<i64> = tops.iter().zip(&shifts).map(|(t, s)| t + s).collect();
            let valid = other[0] >= 0
                && other.iter().zip(&heights).all(|(t, &h)| t + h as i64 <= space as i64)
                && other.windows(2).zip(&heights).all(|(w, &h)| w[0] + h as i64 <= w[1]);
            // Rounding to pixels costs up to a quarter of a pixel squared per label.
            let rounding = 0.25 * tops.len() as f64 + 1e-6;
            prop_assert!(!valid || cost(&tops) <= cost(&other) + rounding);
        }

        #[test]
        fn entries_of_a_legend_never_overlap(
            texts in prop::collection::vec(("\\PC{0,30}", 0..3usize), 1..12),
            group in 1..5usize,
            size in 8.0..40.0f64,
            width in 1..900usize,
        ) {
            let mut lettering = Lettering::new(size);
            let entry = |(text, mark): &(String, usize)| Entry {
                mark: match mark {
                    0 => Mark::None,
                    1 => Mark::Swatch([9; 3]),
                    _ => Mark::Bar(vec![[1; 3], [2; 3]]),
                },
                text: text.clone(),
            };
            let groups = texts.chunks(group).map(|g| g.iter().map(entry).collect()).collect();
            let legend = Legend::new(groups, &mut lettering, width);
            prop_assert!(legend.size.0 <= width);
            for (i, (a, _)) in legend.entries.iter().enumerate() {
                prop_assert!(a.left + a.width <= legend.size.0);
                prop_assert!(a.top + a.height <= legend.size.1);
                prop_assert!(legend.entries[..i].iter().all(|(b, _)| !intersect(a, b)));
            }
        }

        #[test]
        fn titles_stay_in_their_tiles(
            name in "\\PC{0,40}",
            note in "\\PC{0,12}",
            width in 0..300usize,
        ) {
            let mut lettering = Lettering::new(16.0);
            let mut sheet = Photo::filled(340, 60, [0; 3]);
            let ink = [255; 3];
            title(&mut sheet, (20, 20), width, &mut lettering, (&name, ink), (&note, ink));
            if let Some((left, top, right, bottom)) = sheet.bounding_box_where(|p| *p != [0; 3]) {
                prop_assert!(left >= 20 && right <= 20 + width);
                prop_assert!(top >= 20 && bottom <= 20 + lettering.line_px());
            }
        }
    }
}
