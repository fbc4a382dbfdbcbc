//! The residual sheet: the distance of each outline from the fitted body, and the number of views that see each vertex.

use glam::DVec2;
use pirouette_geom::contour::trace_windowed;
use pirouette_geom::distance_map::{bilinear, signed_distance_within};
use pirouette_geom::parallel::prelude::*;
use pirouette_geom::{Grid, Mask, Windowed};

use super::canvas::{Color, Crop, PixelBox, Tint, mix, paste, shrink, sized_box, stroke};
use super::font::Lettering;
use super::labels::{Entry, Legend, Mark, title};
use pirouette::scan::Photo;
use pirouette_body::TurnAngle;

/// A view whose silhouette is compared with that of the fitted body
#[derive(Debug, Clone, Copy)]
pub struct ResidualView<'a> {
    /// Name of the view
    pub name: &'a str,
    /// Turn angle of the person in this view
    pub turn: TurnAngle,
    /// The photo
    pub photo: &'a Photo,
    /// Soft silhouette in the photo
    pub silhouette: &'a Windowed<f32>,
    /// The silhouette thresholded at a coverage of one half
    pub mask: &'a Mask,
    /// Silhouette of the fitted body in the pose of this view
    pub body: &'a Mask,
    /// Size of a pixel at the turning axis
    pub mm_per_px: f64,
}

/// The body, each vertex in [`count_color`] of the views that see it
#[derive(Debug, Clone, Copy)]
pub struct SeenBody<'a> {
    /// The displayed side of the body
    pub label: &'a str,
    /// Rendering by the camera of the views
    pub picture: &'a Photo,
    /// Silhouette of the body in that rendering
    pub silhouette: &'a Mask,
}

const TILE_HEIGHT_PX: usize = 480;
const TILES_PER_BAND: usize = 5;
const GAP_PX: usize = 6;

/// Size of the text, in px
const TEXT_PX: f64 = 18.0;

/// Minimum width of a sheet, in px, for the legend
const MIN_WIDTH_PX: usize = 640;

/// Width of the outlines in the tiles, in px, without and with their dark border
const LINE_PX: f64 = 2.4;
const BORDER_PX: f64 = 4.4;

/// Distance at which outlines reach the full color, in mm
///
/// Several times the residual of a good fit (2 to 3 mm), so that only larger ones have strong colors.
const FULL_COLOR_MM: f64 = 15.0;

/// Steps between white and the full color
const COLOR_STEPS: i32 = 10;

const PAPER: Color = [250, 250, 250];
const INK: Color = [40, 44, 52];
const PALE_INK: Color = [125, 131, 142];
const DARK: Color = [26, 28, 34];
const INSIDE: Color = [40, 120, 255];
const OUTSIDE: Color = [255, 50, 35];

/// Distances are clamped to this value, in px
const FAR_PX: f32 = 20.0;

/// Margin around silhouette and body within which distances are sampled, in px
const MARGIN_PX: usize = 3;

/// Brightness of the photo behind the outlines, as a fraction
const DIMMED: f64 = 0.45;

/// Draws, for each view, the outline in the photo colored by its distance from that of the fitted body, then the bodies
///
/// The color is white on the outline of the body, blue inside it (the body is too large there), red outside. Distances
/// are measured to pixels of the body, so they are accurate to half a pixel. `view_count` is the largest count in the
/// legend of the bodies.
pub fn residual_sheet(views: &[ResidualView], bodies: &[SeenBody], view_count: usize) -> Photo {
    let masks = views.iter().flat_map(|view| [view.mask, view.body]);
    let masks = masks.chain(bodies.iter().map(|body| body.silhouette));
    let crop = Crop::around(masks.filter_map(sized_box));
    let sizes = views.iter().map(|v| v.photo);
    let tile_width = crop.tile_width(
        sizes.chain(bodies.iter().map(|b| b.picture)),
        TILE_HEIGHT_PX,
    );
    let mut lettering = Lettering::new(TEXT_PX);
    let line = lettering.line_px() + GAP_PX / 2;
    let columns = (views.len() + bodies.len()).clamp(1, TILES_PER_BAND);
    let bands = (views.len() + bodies.len()).div_ceil(TILES_PER_BAND).max(1);
    let band_height = line + TILE_HEIGHT_PX + GAP_PX;
    let width = (GAP_PX + columns * (tile_width + GAP_PX)).max(MIN_WIDTH_PX);
    let legend = Legend::new(
        legend_entries(view_count),
        &mut lettering,
        width - 2 * GAP_PX,
    );
    let height = bands * band_height + legend.size.1 + 3 * GAP_PX;
    let mut sheet = Photo::filled(width, height, PAPER);

    let tiles: Vec<_> = views
        .par_iter()
        .map(|view| {
            let (tile, mean_mm) = tile(view, crop, tile_width);
            let mean = mean_mm.map_or(String::new(), |mm| format!("  {mm:.1} mm"));
            let note = format!("{:.0}°{mean}", view.turn.degrees());
            (tile, view.name, note)
        })
        .collect();
    let seen = bodies.iter().map(|body| {
        let tile = shrink(body.picture, crop, tile_width, TILE_HEIGHT_PX);
        (tile, body.label, String::new())
    });
    for (place, (tile, name, note)) in tiles.into_iter().chain(seen).enumerate() {
        let left = GAP_PX + place % TILES_PER_BAND * (tile_width + GAP_PX);
        let top = GAP_PX + place / TILES_PER_BAND * band_height;
        let (name, note) = ((name, INK), (note.as_str(), PALE_INK));
        let corner = (left, top);
        title(&mut sheet, corner, tile_width, &mut lettering, name, note);
        paste(&mut sheet, &tile, (left, top + line));
    }
    let corner = (GAP_PX, bands * band_height + GAP_PX);
    legend.draw(&mut sheet, corner, &mut lettering, INK);
    sheet
}

/// Draws the dimmed photo with its outline; returns it with the mean distance of the outline, in mm
fn tile(view: &ResidualView, crop: Crop, tile_width: usize) -> (Photo, Option<f64>) {
    let mut tile = shrink(view.photo, crop, tile_width, TILE_HEIGHT_PX);
    let dimmed = Tint::new(DARK, 1.0 - DIMMED);
    for pixel in tile.as_mut_slice() {
        dimmed.apply(pixel);
    }
    let size = DVec2::new(
        view.silhouette.width() as f64,
        view.silhouette.height() as f64,
    );
    let tile_from_photo = |p: DVec2| {
        let offset = p / size - DVec2::new(crop.left, crop.top);
        let extent = DVec2::new(crop.right - crop.left, crop.bottom - crop.top);
        offset / extent * DVec2::new(tile_width as f64, TILE_HEIGHT_PX as f64)
    };
    // Pixels outside both boxes are far from both outlines.
    let boxes = [view.mask, view.body].into_iter();
    let boxes = boxes.filter_map(|mask| mask.bounding_box());
    let (x0, y0, x1, y1) = boxes
        .reduce(|a, b| (a.0.min(b.0), a.1.min(b.1), a.2.max(b.2), a.3.max(b.3)))
        .unwrap_or_default();
    let (x0, y0) = (x0.saturating_sub(MARGIN_PX), y0.saturating_sub(MARGIN_PX));
    let pixels = (x0, y0, x1 + MARGIN_PX, y1 + MARGIN_PX);
    let distance_px = signed_distance_within(&cropped(view.body, pixels), FAR_PX);
    let distance_px = distance_px.map(|d| d.clamp(-FAR_PX, FAR_PX));
    let corner = DVec2::new(x0 as f64, y0 as f64);
    let mut steps = vec![Vec::new(); 2 * COLOR_STEPS as usize + 1];
    let mut all = Vec::new();
    let (mut sum, mut total) = (0.0, 0.0);
    for contour in trace_windowed(view.silhouette, 0.5) {
        for [a, b] in contour.edges() {
            let off_mm = bilinear(&distance_px, (a + b) / 2.0 - corner) * view.mm_per_px;
            if off_mm.is_nan() {
                continue;
            }
            let line = [tile_from_photo(a), tile_from_photo(b)];
            let step = (off_mm / FULL_COLOR_MM).clamp(-1.0, 1.0) * f64::from(COLOR_STEPS);
            steps[(step.round() as i32 + COLOR_STEPS) as usize].push(line);
            all.push(line);
            sum += off_mm.abs() * (b - a).length();
            total += (b - a).length();
        }
    }
    stroke(&mut tile, &all, BORDER_PX, DARK);
    for (step, lines) in steps.iter().enumerate() {
        let color = step_color(step as i32 - COLOR_STEPS);
        stroke(&mut tile, lines, LINE_PX, color);
    }
    let mean_mm = sum / total;
    (tile, mean_mm.is_finite().then_some(mean_mm))
}

/// Returns the pixels of a box, clipped to the grid
fn cropped<T: Clone>(grid: &Grid<T>, (x0, y0, x1, y1): PixelBox) -> Grid<T> {
    let (x1, y1) = (x1.min(grid.width()), y1.min(grid.height()));
    let (x0, y0) = (x0.min(x1), y0.min(y1));
    grid.crop(x0, y0, x1 - x0, y1 - y0)
}

/// Returns the color of a distance: blue below zero, white at zero, red above
fn step_color(step: i32) -> Color {
    let mut color = [255; 3];
    let full = if step < 0 { INSIDE } else { OUTSIDE };
    // The exponent keeps small distances visible.
    let share = f64::from(step.abs()) / f64::from(COLOR_STEPS);
    mix(&mut color, full, share.powf(0.8));
    color
}

/// Returns the color of a vertex by the number of views that see it: dark for none, then from purple over green to
/// yellow
pub fn count_color(count: usize) -> [u8; 3] {
    const COLORS: [Color; 6] = [
        [45, 45, 48],
        [104, 52, 140],
        [62, 90, 165],
        [36, 142, 140],
        [90, 190, 90],
        [250, 225, 50],
    ];
    COLORS[count.min(COLORS.len() - 1)]
}

/// Counts from this value on have the same color
const LAST_COUNT: usize = 5;

/// Returns the scale of distances, and the scale of counts in a second group
fn legend_entries(view_count: usize) -> Vec<Vec<Entry>> {
    let steps = -COLOR_STEPS..=COLOR_STEPS;
    let distances = Entry {
        mark: Mark::Bar(steps.map(step_color).collect()),
        text: format!("−{FULL_COLOR_MM:.0} mm to +{FULL_COLOR_MM:.0} mm"),
    };
    let mut counts: Vec<Entry> = (0..=view_count.min(LAST_COUNT))
        .map(|count| {
            let more = count == LAST_COUNT && view_count > LAST_COUNT;
            let text = format!("{count}{}", if more { "+" } else { "" });
            Entry::swatch(count_color(count), &text)
        })
        .collect();
    counts.push(Entry::plain(
        "number of views that see a point of the surface",
    ));
    vec![
        vec![
            distances,
            Entry::plain("outline of the photo: inside (blue) or outside (red) of the fitted body"),
            Entry::plain("above each view: mean absolute distance"),
        ],
        counts,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A soft-edged box whose left side lies at a given column
    fn upright(left: usize) -> Grid<f32> {
        Grid::from_fn(100, 200, |x, y| {
            f32::from(u8::from((left..70).contains(&x) && (40..160).contains(&y)))
        })
    }

    fn count(picture: &Photo, is: impl Fn(i32, i32) -> bool) -> usize {
        let pixels = picture.as_slice().iter();
        pixels
            .filter(|p| is(i32::from(p[0]), i32::from(p[2])))
            .count()
    }

    fn colors(left: usize, body_left: usize) -> (usize, usize, Option<f64>) {
        let photo = Photo::filled(100, 200, [90; 3]);
        let silhouette = upright(left);
        let view = ResidualView {
            name: "a",
            turn: TurnAngle::from_degrees(45.0),
            photo: &photo,
            silhouette: &Windowed::new(&silhouette),
            mask: &silhouette.threshold(0.5),
            body: &upright(body_left).threshold(0.5),
            mm_per_px: 2.0,
        };
        let (tile, mean_mm) = tile(&view, Crop::FULL, 240);
        let blue = count(&tile, |r, b| b > r + 60);
        let red = count(&tile, |r, b| r > b + 60);
        (blue, red, mean_mm)
    }

    #[test]
    fn red_is_outside_of_the_body_and_blue_inside() {
        let (blue, red, mean_mm) = colors(30, 30);
        assert_eq!((blue, red), (0, 0));
        assert!(mean_mm.unwrap() < 0.5, "{mean_mm:?}");
        let (blue, red, mean_mm) = colors(20, 30);
        assert!(red > 400 && blue == 0, "{blue} {red}");
        // 120 of 340 px are off by 20 mm, and ten at either end by 10 mm on average.
        assert!((5.0..9.0).contains(&mean_mm.unwrap()), "{mean_mm:?}");
        let (blue, red, _) = colors(40, 30);
        assert!(blue > 400 && red == 0, "{blue} {red}");
    }

    #[test]
    fn sheets_contain_all_tiles_and_legends() {
        let photo = Photo::filled(100, 200, [9, 200, 9]);
        let (silhouette, body) = (upright(30), upright(35).threshold(0.5));
        let mask = silhouette.threshold(0.5);
        let view = ResidualView {
            name: "view",
            turn: TurnAngle::default(),
            photo: &photo,
            silhouette: &Windowed::new(&silhouette),
            mask: &mask,
            body: &body,
            mm_per_px: 2.0,
        };
        let seen = SeenBody {
            label: "Front",
            picture: &photo,
            silhouette: &body,
        };
        let few = residual_sheet(&[view; 3], &[seen; 2], 3);
        let many = residual_sheet(&[view; 8], &[seen; 2], 8);
        assert!(many.height() > few.height() + TILE_HEIGHT_PX);
        let green = |sheet: &Photo| {
            sheet
                .as_slice()
                .iter()
                .filter(|&&p| p == [9, 200, 9])
                .count()
        };
        assert_eq!(green(&few), green(&many));
        assert!(green(&few) > 0);
    }

    #[test]
    fn empty_input_is_accepted() {
        assert!(residual_sheet(&[], &[], 0).width() > 0);
        let photo = Photo::filled(0, 0, [0; 3]);
        let dot = Photo::filled(1, 1, [0; 3]);
        let (none, nan) = (Grid::filled(0, 0, 0.0), Grid::filled(1, 1, f32::NAN));
        for (photo, silhouette, body) in [
            (&photo, &none, &none),
            (&dot, &nan, &none),
            (&dot, &upright(3), &nan),
            (&dot, &upright(3), &upright(900)),
        ] {
            let view = ResidualView {
                name: "漢字",
                turn: TurnAngle::from_degrees(f64::NAN),
                photo,
                silhouette: &Windowed::new(silhouette),
                mask: &silhouette.threshold(0.5),
                body: &body.threshold(0.5),
                mm_per_px: f64::NAN,
            };
            assert!(residual_sheet(&[view], &[], 1).width() > 0);
        }
    }
}
