//! The contact sheet: one column per view, one row per stage.

use std::ops::Range;

use pirouette_geom::parallel::prelude::*;
use pirouette_geom::{Grid, Mask};

use super::canvas::{Color, Crop, mix, paste, shrink, shrink_rows, sized_box, tint_box};
use super::font::Lettering;
use super::labels::{Entry, Legend, title};
use pirouette::scan::Photo;
use pirouette_body::TurnAngle;

/// Contents of the column of one view; a tile whose picture is `None` stays empty
#[derive(Debug, Clone, Copy)]
pub struct ContactView<'a> {
    /// Name of the view
    pub name: &'a str,
    /// Turn angle of the person in this view
    pub turn: TurnAngle,
    /// The photo
    pub photo: &'a Photo,
    /// The segmented silhouette
    pub mask: Option<&'a Mask>,
    /// The pose-normalized silhouette
    pub normalized: Option<&'a Mask>,
    /// Coverage of the reference at this turn angle, 255 for complete coverage; of any size
    pub reference: Option<&'a Grid<u8>>,
    /// The reconstructed body as seen in this view
    pub body: Option<&'a Photo>,
}

/// Heights of the rows of a sheet, in px
const TILE_HEIGHT_PX: usize = 300;

/// Maximum number of views in one band; further views start another band below
const VIEWS_PER_BAND: usize = 12;

/// Space between tiles, in px
const GAP_PX: usize = 6;

/// Size of the text, in px
const TEXT_PX: f64 = 17.0;

/// Minimum width of a sheet, in px, for the legend
const MIN_WIDTH_PX: usize = 560;

const PAPER: Color = [250, 250, 250];
const INK: Color = [40, 44, 52];
const PALE_INK: Color = [125, 131, 142];
const FAINT: Color = [228, 230, 234];
const SILHOUETTE: Color = [60, 66, 78];
/// Blue and orange are distinguishable with every type of color vision
const BOTH: Color = [196, 199, 206];
const ONLY_NORMALIZED: Color = [230, 110, 20];
const ONLY_REFERENCE: Color = [30, 105, 210];

const ROWS: [&str; 4] = ["Photo", "Mask", "Normalized", "Body"];

/// Puts all views on one sheet: photo, mask, normalized silhouette over the reference, body
///
/// All tiles show the same crop of their pictures: the one that contains all silhouettes. Pictures of one view may
/// differ in size. More than twelve views are put into several bands; without views the sheet has labels only.
pub fn contact_sheet(views: &[ContactView]) -> Photo {
    let crop = common_crop(views);
    let tile_width = tile_width(views, crop);
    let mut lettering = Lettering::new(TEXT_PX);
    let label_width = widest(&ROWS, &mut lettering) + 2 * GAP_PX;
    let line = lettering.line_px() + GAP_PX / 2;
    let columns = views.len().clamp(1, VIEWS_PER_BAND);
    let bands = views.len().div_ceil(VIEWS_PER_BAND).max(1);
    let band_height = line + ROWS.len() * (TILE_HEIGHT_PX + GAP_PX) + GAP_PX;
    let width = (label_width + columns * (tile_width + GAP_PX)).max(MIN_WIDTH_PX);
    let entries = LEGEND.map(|(text, color)| Entry::swatch(color, text));
    let legend_width = width - label_width - GAP_PX;
    let legend = Legend::new(vec![entries.to_vec()], &mut lettering, legend_width);
    let height = bands * band_height + legend.size.1 + 3 * GAP_PX;
    let mut sheet = Photo::filled(width, height, PAPER);

    for band in 0..bands {
        let top = GAP_PX + band * band_height + line;
        for (row, label) in ROWS.iter().enumerate() {
            let middle = top + row * (TILE_HEIGHT_PX + GAP_PX) + TILE_HEIGHT_PX / 2;
            let corner = (GAP_PX, middle - lettering.line_px() / 2);
            lettering.draw(&mut sheet, corner, label, INK);
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
        let (name, angle) = ((view.name, INK), (angle.as_str(), PALE_INK));
        let corner = (left, top);
        title(&mut sheet, corner, tile_width, &mut lettering, name, angle);
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
    legend.draw(&mut sheet, (label_width, bottom), &mut lettering, INK);
    sheet
}

fn widest(texts: &[&str], lettering: &mut Lettering) -> usize {
    let widths = texts.iter().map(|text| lettering.width(text));
    widths.max().unwrap_or(0)
}

/// Returns the four tiles of a view
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

/// Draws the normalized silhouette over the reference: gray inside both, a color inside only one
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

/// Returns the width that keeps the aspect ratio of the crop of the first photo
fn tile_width(views: &[ContactView], crop: Crop) -> usize {
    crop.tile_width(views.iter().map(|view| view.photo), TILE_HEIGHT_PX)
}

/// Returns the crop that contains all silhouettes, with a margin
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
    ("in both", BOTH),
    ("normalized only", ONLY_NORMALIZED),
    ("reference only", ONLY_REFERENCE),
];

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
    fn colors_of_the_comparison_show_which_silhouette_covers() {
        let normalized = Mask::from_art("##..");
        let reference = Grid::from_vec(4, 1, vec![255, 0, 255, 0]);
        let picture = compare(Some(&normalized), Some(&reference), Crop::FULL, 4).unwrap();
        let expected = [BOTH, ONLY_NORMALIZED, ONLY_REFERENCE, [255; 3]];
        assert_eq!(picture.row(0), expected);
        assert!(compare(None, None, Crop::FULL, 4).is_none());
    }

    #[test]
    fn tiles_show_the_crop_with_the_silhouettes() {
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
    fn sheets_of_any_number_of_views_contain_all_tiles() {
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
    fn empty_photos_and_masks_are_accepted() {
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
