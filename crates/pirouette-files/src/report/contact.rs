//! All views at a glance: one column per view, one row per stage.

use std::ops::Range;

use pirouette_geom::{Grid, Mask};
use rayon::prelude::*;

use super::canvas::{self, Color, Crop, mix, paste, shrink, shrink_rows, sized_box, tint_box};
use super::font;
use pirouette::scan::Photo;
use pirouette_body::TurnAngle;

/// What the sheet shows of one view; what is missing leaves an empty tile
#[derive(Debug, Clone, Copy)]
pub struct ContactView<'a> {
    /// Name of the view
    pub name: &'a str,
    /// How far the person has turned
    pub turn: TurnAngle,
    /// The photo
    pub photo: &'a Photo,
    /// The silhouette as segmented
    pub mask: Option<&'a Mask>,
    /// The pose-normalized silhouette
    pub normalized: Option<&'a Mask>,
    /// Coverage of the reference at that angle, 255 where it covers a pixel as a whole; of any size
    pub reference: Option<&'a Grid<u8>>,
    /// The reconstructed body as seen in this view
    pub body: Option<&'a Photo>,
}

/// Heights of the rows of a sheet, in px
const TILE_HEIGHT_PX: usize = 300;

/// Views in one band; more views start another band below
const VIEWS_PER_BAND: usize = 12;

/// Space between tiles, in px
const GAP_PX: usize = 6;

/// Pixels per dot of the labels
const TEXT_SCALE: usize = 2;

const PAPER: Color = [250, 250, 250];
const INK: Color = [40, 44, 52];
const PALE_INK: Color = [125, 131, 142];
const FAINT: Color = [228, 230, 234];
const SILHOUETTE: Color = [60, 66, 78];
/// Blue and orange differ for every kind of color vision
const BOTH: Color = [196, 199, 206];
const ONLY_NORMALIZED: Color = [230, 110, 20];
const ONLY_REFERENCE: Color = [30, 105, 210];

const ROWS: [&str; 4] = ["photo", "mask", "normalized", "body"];

/// Puts all views on one sheet: photo, mask, normalized silhouette over the reference, body
///
/// All tiles show the same part of their pictures, the one where persons are. Pictures of one view may differ in
/// size. More than twelve views go into several bands; without views the sheet has labels only.
pub fn contact_sheet(views: &[ContactView]) -> Photo {
    let crop = common_crop(views);
    let tile_width = tile_width(views, crop);
    let label_width = ROWS
        .iter()
        .map(|row| canvas::text_size(row, TEXT_SCALE).0)
        .max()
        .unwrap_or(0)
        + 2 * GAP_PX;
    let line = canvas::text_size("", TEXT_SCALE).1 + GAP_PX;
    let columns = views.len().clamp(1, VIEWS_PER_BAND);
    let bands = views.len().div_ceil(VIEWS_PER_BAND).max(1);
    let band_height = line + ROWS.len() * (TILE_HEIGHT_PX + GAP_PX) + GAP_PX;
    let legend_width = legend_width() + label_width + GAP_PX;
    let width = (label_width + columns * (tile_width + GAP_PX)).max(legend_width);
    let mut sheet = Photo::filled(width, bands * band_height + line + GAP_PX, PAPER);

    for band in 0..bands {
        let top = GAP_PX + band * band_height + line;
        for (row, label) in ROWS.iter().enumerate() {
            let middle = top + row * (TILE_HEIGHT_PX + GAP_PX) + TILE_HEIGHT_PX / 2;
            canvas::write(&mut sheet, (GAP_PX, middle), label, TEXT_SCALE, INK);
        }
    }
    let drawn: Vec<_> = views
        .par_iter()
        .map(|view| tiles(view, crop, tile_width))
        .collect();
    for (index, (view, tiles)) in views.iter().zip(drawn).enumerate() {
        let left = label_width + index % VIEWS_PER_BAND * (tile_width + GAP_PX);
        let top = GAP_PX + index / VIEWS_PER_BAND * band_height;
        let angle = format!("{:.0}°", view.turn.degrees());
        title(&mut sheet, (left, top), tile_width, view.name, &angle);
        for (row, tile) in tiles.into_iter().enumerate() {
            let corner = (left, top + line + row * (TILE_HEIGHT_PX + GAP_PX));
            match tile {
                Some(tile) => paste(&mut sheet, &tile, corner),
                None => {
                    let size = (tile_width, TILE_HEIGHT_PX);
                    tint_box(&mut sheet, corner, size, FAINT, 1.0);
                }
            }
        }
    }
    let bottom = bands * band_height + GAP_PX;
    legend(&mut sheet, (label_width, bottom));
    sheet
}

/// Name and angle; a long name loses its end
fn title(sheet: &mut Photo, (left, top): (usize, usize), width: usize, name: &str, angle: &str) {
    let wide = |text: &str| canvas::text_size(text, TEXT_SCALE).0;
    let gap = 5 * TEXT_SCALE;
    let room = width.saturating_sub(wide(angle) + 2 * gap);
    let mut shown: String = name.to_owned();
    if wide(&shown) > room {
        while !shown.is_empty() && wide(&shown) + wide("..") > room {
            shown.pop();
        }
        shown.push_str("..");
    }
    canvas::write(sheet, (left, top), &shown, TEXT_SCALE, INK);
    let after = left + wide(&shown) + gap;
    canvas::write(sheet, (after, top), angle, TEXT_SCALE, PALE_INK);
}

/// The four tiles of a view
fn tiles(view: &ContactView, crop: Crop, width: usize) -> [Option<Photo>; 4] {
    let tile = |picture: &Photo| shrink(picture, crop, width, TILE_HEIGHT_PX);
    let mask = view.mask.map(|mask| {
        let size = (mask.width(), mask.height());
        shrink_rows(size, crop, width, TILE_HEIGHT_PX, |y, columns, row| {
            for (color, &inside) in row.iter_mut().zip(&mask.row(y)[columns]) {
                *color = if inside { SILHOUETTE } else { [255; 3] };
            }
        })
    });
    [
        Some(tile(view.photo)),
        mask,
        compare(view.normalized, view.reference, crop, width),
        view.body.map(tile),
    ]
}

/// The normalized silhouette over the reference: gray where both are, a color where only one is
fn compare(
    normalized: Option<&Mask>,
    reference: Option<&Grid<u8>>,
    crop: Crop,
    tile_width: usize,
) -> Option<Photo> {
    let size = normalized
        .map(|n| (n.width(), n.height()))
        .or(reference.map(|r| (r.width(), r.height())))?;
    let draw = |y: usize, columns: Range<usize>, row: &mut [Color]| {
        let ours = normalized.map(|mask| mask.row(y));
        let theirs = reference.map(|r| (r.row(y * r.height() / size.1), r.width()));
        for (x, color) in columns.zip(row) {
            let ours = ours.is_some_and(|mask| mask[x]);
            let covered = theirs.map_or(0, |(row, width)| row[x * width / size.0]);
            let (without, with) = if ours {
                (ONLY_NORMALIZED, BOTH)
            } else {
                ([255; 3], ONLY_REFERENCE)
            };
            *color = without;
            if covered == u8::MAX {
                *color = with;
            } else if covered > 0 {
                mix(color, with, f64::from(covered) / 255.0);
            }
        }
    };
    Some(shrink_rows(size, crop, tile_width, TILE_HEIGHT_PX, draw))
}

/// Width that keeps the proportions of the first photo's part
fn tile_width(views: &[ContactView], crop: Crop) -> usize {
    crop.tile_width(views.iter().map(|view| view.photo), TILE_HEIGHT_PX)
}

/// The part of the pictures where any silhouette is, with a margin
fn common_crop(views: &[ContactView]) -> Crop {
    let boxes = views.iter().flat_map(|view| {
        let reference = view.reference.and_then(|coverage| {
            let size = (coverage.width() as f64, coverage.height() as f64);
            Some((coverage.bounding_box_where(|&v| v >= 128)?, size))
        });
        [
            view.mask.and_then(sized_box),
            view.normalized.and_then(sized_box),
            reference,
        ]
    });
    Crop::around(boxes.flatten())
}

const LEGEND: [(&str, Color); 3] = [
    ("both", BOTH),
    ("normalized only", ONLY_NORMALIZED),
    ("reference only", ONLY_REFERENCE),
];

/// Side of a legend's color sample, in px
const SWATCH_PX: usize = font::ASCENT * TEXT_SCALE;

fn legend_width() -> usize {
    let texts = LEGEND
        .iter()
        .map(|(text, _)| canvas::text_size(text, TEXT_SCALE).0);
    texts.map(|width| width + SWATCH_PX + 4 * GAP_PX).sum()
}

fn legend(sheet: &mut Photo, (mut left, top): (usize, usize)) {
    for (text, color) in LEGEND {
        tint_box(sheet, (left, top), (SWATCH_PX, SWATCH_PX), color, 1.0);
        left += SWATCH_PX + GAP_PX;
        canvas::write(sheet, (left, top), text, TEXT_SCALE, INK);
        left += canvas::text_size(text, TEXT_SCALE).0 + 3 * GAP_PX;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bare<'a>(name: &'a str, photo: &'a Photo) -> ContactView<'a> {
        ContactView {
            name,
            turn: TurnAngle::from_degrees(45.0),
            photo,
            mask: None,
            normalized: None,
            reference: None,
            body: None,
        }
    }

    #[test]
    fn comparing_colors_tell_who_covers_what() {
        let normalized = Mask::from_art("##..");
        let reference = Grid::from_vec(4, 1, vec![255, 0, 255, 0]);
        let picture = compare(Some(&normalized), Some(&reference), Crop::WHOLE, 4).unwrap();
        let expected = [BOTH, ONLY_NORMALIZED, ONLY_REFERENCE, [255; 3]];
        assert_eq!(picture.row(0), expected);
        assert!(compare(None, None, Crop::WHOLE, 4).is_none());
    }

    #[test]
    fn tiles_show_the_part_with_persons() {
        let mask = Mask::from_fn(100, 200, |x, y| {
            (40..60).contains(&x) && (50..150).contains(&y)
        });
        let photo = Photo::filled(100, 200, [7; 3]);
        let view = ContactView {
            mask: Some(&mask),
            ..bare("a", &photo)
        };
        let crop = common_crop(&[view]);
        assert!((crop.left - 0.388).abs() < 1e-9 && (crop.bottom - 0.78).abs() < 1e-9);
        let [photo, mask, normalized, body] = tiles(&view, crop, tile_width(&[view], crop));
        assert_eq!(photo.unwrap().height(), TILE_HEIGHT_PX);
        let mask = mask.unwrap();
        assert_eq!(mask[(mask.width() / 2, mask.height() / 2)], SILHOUETTE);
        assert_eq!(mask[(1, 1)], [255; 3]);
        assert!(normalized.is_none() && body.is_none());
    }

    #[test]
    fn sheets_of_any_number_of_views_hold_all_tiles() {
        let photo = Photo::filled(80, 100, [200, 10, 10]);
        let one = contact_sheet(&[bare("000", &photo)]);
        let many = contact_sheet(&vec![bare("a very long name of a view", &photo); 30]);
        assert!(many.height() > 2 * one.height() && many.width() > 5 * 240);
        let red = |sheet: &Photo| {
            let pixels = sheet.as_slice().iter();
            pixels.filter(|&&pixel| pixel == [200, 10, 10]).count()
        };
        assert_eq!(red(&one), 240 * 300);
        assert_eq!(red(&many), 30 * 240 * 300);
        assert!(contact_sheet(&[]).width() > 0);
    }

    #[test]
    fn empty_photos_and_masks_do_not_break_it() {
        let nothing = Photo::filled(0, 0, [0; 3]);
        let dot = Photo::filled(1, 1, [0; 3]);
        let empty = Mask::filled(3, 3, false);
        let flat = Photo::filled(1000, 1, [0; 3]);
        let views = [
            bare("", &nothing),
            ContactView {
                mask: Some(&empty),
                normalized: Some(&empty),
                ..bare("漢字", &dot)
            },
            bare("flat", &flat),
        ];
        assert!(contact_sheet(&views).width() > 0);
    }
}
