//! The tape sheet: the body from the front and from the side, with the tapes and their lengths.

use glam::{DVec2, DVec3};
use pirouette_geom::TriMesh;

use super::canvas::{Color, disc, paste, stroke};
use super::font::Lettering;
use super::labels::{Entry, LabelBox, Legend, spread, title, title_width};
use pirouette::measure::{Girth, Measure, Measured, Measurements, Method};
use pirouette::scan::Photo;
use pirouette_body::render::{SilhouetteMesh, shade};
use pirouette_body::{Camera, TurnAngle};

/// Columns and rows of each of the two pictures
const TILE_PX: (usize, usize) = (700, 1000);

/// Columns for the labels to the left and to the right of the front
const LABEL_WIDTH_PX: usize = 330;

/// Rows for the titles of the pictures, and for the legend below them
const TITLE_HEIGHT_PX: usize = 40;
const LEGEND_HEIGHT_PX: usize = 46;

const PAPER: Color = [250; 3];
const TAPE_COLOR: Color = [214, 40, 57];
const HIDDEN_COLOR: Color = [240, 170, 170];
const LEADER_COLOR: Color = [92, 98, 110];
const INK: Color = [30, 30, 30];
const PALE_INK: Color = [110, 116, 126];

/// Size of the text, in px
const TEXT_PX: f64 = 20.0;

const LINE_PX: f64 = 3.0;
const LEADER_PX: f64 = 1.3;
const ANCHOR_PX: f64 = 3.2;

/// Space between a label and its leader, and between labels, in px
const LABEL_GAP_PX: usize = 8;

/// Space between labels and the border of the sheet, in px
const BORDER_PX: usize = 14;

/// Tapes whose center is farther to the right of the body's middle than this have their label on the right, in px
const CENTRAL_PX: f64 = 12.0;

/// Draws a body from the front and from its right side, with tapes and their lengths; hidden parts of tapes are pale
///
/// `body` is in the world frame, mm; `mesh` has its triangles. A body without area gives an empty sheet.
pub fn tape_sheet(body: &TriMesh, mesh: &SilhouetteMesh, measurements: &Measurements) -> Photo {
    let (width, height) = TILE_PX;
    let sheet_height = TITLE_HEIGHT_PX + height + LEGEND_HEIGHT_PX;
    let mut sheet = Photo::filled(2 * (width + LABEL_WIDTH_PX), sheet_height, PAPER);
    let Some((low, high)) = body.bounds().filter(|(low, high)| high.y > low.y) else {
        return sheet;
    };
    let camera = far_camera(low, high);
    let from = |degrees: f64| {
        let turn = TurnAngle::from_degrees(degrees).room_from_world();
        let turned =
            |points: &[DVec3]| -> Vec<DVec3> { points.iter().map(|&p| turn * p).collect() };
        let mut tile = shade(mesh, &turned(&body.positions), None, &camera);
        for (_, curve) in &measurements.tapes {
            draw_tape(&mut tile, &turned(curve), &camera);
        }
        tile
    };
    let (front, side) = pirouette_geom::parallel::join(|| from(0.0), || from(90.0));
    let mut lettering = Lettering::new(TEXT_PX);
    let tiles = [
        (LABEL_WIDTH_PX, front, "Front"),
        (2 * LABEL_WIDTH_PX + width, side, "Right side"),
    ];
    let title_top = (TITLE_HEIGHT_PX - lettering.line_px()) / 2;
    for (left, tile, title) in tiles {
        paste(&mut sheet, &tile, (left, TITLE_HEIGHT_PX));
        lettering.draw(&mut sheet, (left, title_top), title, INK);
    }
    draw_labels(&mut sheet, &mut lettering, measurements, &camera);
    let mut entries = vec![
        Entry::swatch(TAPE_COLOR, "Tape"),
        Entry::swatch(HIDDEN_COLOR, "Tape on the far side of the body"),
        Entry::plain("Girths of limbs are the mean of left and right."),
    ];
    let below_clothes = |(_, found): (Measure, &Measured)| found.method == Method::BelowClothes;
    if measurements.iter().any(below_clothes) {
        entries.push(Entry::plain("* Of the body below clothes or hair."));
    }
    let legend = Legend::new(vec![entries], &mut lettering, 2 * width + LABEL_WIDTH_PX);
    let top = TITLE_HEIGHT_PX + height + (LEGEND_HEIGHT_PX - legend.size.1) / 2;
    legend.draw(&mut sheet, (LABEL_WIDTH_PX, top), &mut lettering, INK);
    sheet
}

/// A label and the end of its tape in the front picture, in px of the sheet
struct TapeLabel {
    anchor: DVec2,
    name: String,
    length: String,
}

/// Draws the labels of all tapes in the columns beside the front picture, with leader lines to their tapes
fn draw_labels(
    sheet: &mut Photo,
    lettering: &mut Lettering,
    measurements: &Measurements,
    camera: &Camera,
) {
    let corner = DVec2::new(LABEL_WIDTH_PX as f64, TITLE_HEIGHT_PX as f64);
    let middle = camera.project(DVec3::ZERO).x + corner.x;
    let (mut left, mut right) = (Vec::new(), Vec::new());
    for (girth, curve) in &measurements.tapes {
        let Some((name, length)) = label(*girth, measurements) else {
            continue;
        };
        let points = || curve.iter().map(|&p| camera.project(p) + corner);
        let leftmost = points().min_by(|a, b| a.x.total_cmp(&b.x));
        let rightmost = points().max_by(|a, b| a.x.total_cmp(&b.x));
        let (Some(leftmost), Some(rightmost)) = (leftmost, rightmost) else {
            continue;
        };
        let on_the_right = (leftmost.x + rightmost.x) / 2.0 > middle + CENTRAL_PX;
        let (column, anchor) = if on_the_right {
            (&mut right, rightmost)
        } else {
            (&mut left, leftmost)
        };
        column.push(TapeLabel {
            anchor,
            name,
            length,
        });
    }
    draw_column(sheet, lettering, left, Side::Left);
    draw_column(sheet, lettering, right, Side::Right);
}

/// Side of the front picture
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

/// Draws one column of labels
fn draw_column(
    sheet: &mut Photo,
    lettering: &mut Lettering,
    mut labels: Vec<TapeLabel>,
    side: Side,
) {
    labels.sort_by(|a, b| a.anchor.y.total_cmp(&b.anchor.y));
    let boxes = column_boxes(&labels, lettering, side);
    for (label, place) in labels.iter().zip(boxes) {
        let middle = (place.top + place.height / 2) as f64 + 0.5;
        let gap = LABEL_GAP_PX as f64;
        let (near, edge) = match side {
            Side::Left => (
                (place.left + place.width) as f64 + gap,
                LABEL_WIDTH_PX as f64,
            ),
            Side::Right => (place.left as f64 - gap, (LABEL_WIDTH_PX + TILE_PX.0) as f64),
        };
        let bend = DVec2::new(edge, middle);
        let leader = [[DVec2::new(near, middle), bend], [bend, label.anchor]];
        stroke(sheet, &leader, LEADER_PX, LEADER_COLOR);
        disc(sheet, label.anchor, ANCHOR_PX, LEADER_COLOR);
        let (name, length) = (
            (label.name.as_str(), PALE_INK),
            (label.length.as_str(), INK),
        );
        let corner = (place.left, place.top);
        title(sheet, corner, place.width, lettering, name, length);
    }
}

/// Returns the boxes of the labels of a column, as close to their tapes as possible without overlap
fn column_boxes(labels: &[TapeLabel], lettering: &mut Lettering, side: Side) -> Vec<LabelBox> {
    let line = lettering.line_px() + LABEL_GAP_PX / 2;
    let top = TITLE_HEIGHT_PX as f64;
    let wanted: Vec<f64> = labels
        .iter()
        .map(|label| label.anchor.y - top - line as f64 / 2.0)
        .collect();
    let tops = spread(&wanted, &vec![line; labels.len()], TILE_PX.1);
    let longest = LABEL_WIDTH_PX - BORDER_PX - 2 * LABEL_GAP_PX;
    let boxes = labels.iter().zip(tops).map(|(label, top)| {
        let width = title_width(&label.name, &label.length, lettering).min(longest);
        LabelBox {
            left: match side {
                Side::Left => LABEL_WIDTH_PX - 2 * LABEL_GAP_PX - width,
                Side::Right => LABEL_WIDTH_PX + TILE_PX.0 + 2 * LABEL_GAP_PX,
            },
            top: TITLE_HEIGHT_PX + top,
            width,
            height: lettering.line_px(),
        }
    });
    boxes.collect()
}

/// Returns a distant camera, for which perspective does not enlarge nearer tapes
fn far_camera(low: DVec3, high: DVec3) -> Camera {
    const DISTANCE_STATURES: f64 = 6.0;
    let stature = high.y - low.y;
    let (width_px, height_px) = TILE_PX;
    let span = high.abs().max(low.abs());
    let wide = 2.0 * span.x.max(span.z) * height_px as f64 / width_px as f64;
    let visible = 1.08 * stature.max(wide);
    Camera {
        width_px,
        height_px,
        vertical_fov_radians: 2.0 * (visible / 2.0 / (DISTANCE_STATURES * stature)).atan(),
        height_mm: (low.y + high.y) / 2.0,
        distance_mm: DISTANCE_STATURES * stature,
        pitch_radians: 0.0,
        yaw_radians: 0.0,
        distortion: 0.0,
    }
}

/// Draws the far half of a tape in a pale color, then the near half over it
fn draw_tape(tile: &mut Photo, points: &[DVec3], camera: &Camera) {
    let middle = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let toward = (camera.center() - middle).normalize_or_zero();
    let following = points.iter().cycle().skip(1);
    let (near, far): (Vec<_>, Vec<_>) = points
        .iter()
        .zip(following)
        .partition(|(a, b)| ((**a + **b) / 2.0 - middle).dot(toward) > 0.0);
    for (lines, width, color) in [
        (far, LINE_PX / 2.0, HIDDEN_COLOR),
        (near, LINE_PX, TAPE_COLOR),
    ] {
        let lines: Vec<[DVec2; 2]> = lines
            .into_iter()
            .map(|(a, b)| [camera.project(*a), camera.project(*b)])
            .collect();
        stroke(tile, &lines, width, color);
    }
}

/// Returns the name and length of a tape; `None` for right limbs, whose left ones have the label
fn label(girth: Girth, measurements: &Measurements) -> Option<(String, String)> {
    let measure = Measure::ALL
        .into_iter()
        .find(|m| m.girths().first() == Some(&girth))?;
    let value_mm = measurements.value_mm(measure)?;
    let name = measure.name().replace('_', " ");
    let length = measurements.format_length(value_mm);
    let mark = match measurements.get(measure).method {
        Method::BelowClothes => "*",
        _ => "",
    };
    Some((name, format!("{}{mark}", length.trim())))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use pirouette::measure::{MeasureInput, measure};
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    #[test]
    fn tapes_are_drawn_and_labeled_in_both_pictures() {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let all = measure(&MeasureInput {
            stature_mm: Some(1700.0),
            ..MeasureInput::of_avatar(&avatar)
        });
        let sheet = tape_sheet(
            &avatar.mesh,
            &SilhouetteMesh::new(&avatar.mesh.triangles),
            &all,
        );
        let count = |columns: std::ops::Range<usize>, color: Color| {
            (0..sheet.height())
                .flat_map(|y| columns.clone().map(move |x| (x, y)))
                .filter(|&at| sheet[at] == color)
                .count()
        };
        let (labels, width) = (LABEL_WIDTH_PX, TILE_PX.0);
        assert!(count(labels..labels + width, TAPE_COLOR) > 2000);
        assert!(count(2 * labels + width..sheet.width(), TAPE_COLOR) > 1000);
        assert!(count(0..labels, INK) > 200);
        assert!(count(labels + width..2 * labels + width, INK) > 200);
        let camera = far_camera(DVec3::ZERO, DVec3::new(0.0, 1700.0, 0.0));
        assert!(camera.distance_mm > 9000.0);
    }

    proptest! {
        #[test]
        fn labels_of_a_column_do_not_overlap(
            labels in prop::collection::vec(("\\PC{0,60}", -50.0..1200.0f64), 0..24),
            on_the_right: bool,
        ) {
            let mut lettering = Lettering::new(TEXT_PX);
            let mut labels: Vec<TapeLabel> = labels
                .into_iter()
                .map(|(name, y)| TapeLabel {
                    anchor: DVec2::new(500.0, y),
                    name,
                    length: "1234 mm".to_owned(),
                })
                .collect();
            labels.sort_by(|a, b| a.anchor.y.total_cmp(&b.anchor.y));
            let (side, columns) = if on_the_right {
                let start = LABEL_WIDTH_PX + TILE_PX.0;
                (Side::Right, start..start + LABEL_WIDTH_PX)
            } else {
                (Side::Left, 0..LABEL_WIDTH_PX)
            };
            let boxes = column_boxes(&labels, &mut lettering, side);
            prop_assert_eq!(boxes.len(), labels.len());
            for pair in boxes.windows(2) {
                prop_assert!(pair[0].top + pair[0].height <= pair[1].top);
            }
            for place in boxes {
                prop_assert!(place.left >= columns.start);
                prop_assert!(place.left + place.width <= columns.end);
                prop_assert!(place.top >= TITLE_HEIGHT_PX);
                prop_assert!(place.top + place.height <= TITLE_HEIGHT_PX + TILE_PX.1);
            }
        }
    }

    #[test]
    fn a_body_without_triangles_gives_an_empty_sheet() {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let all = measure(&MeasureInput {
            body: &TriMesh::default(),
            stature_mm: None,
            ..MeasureInput::of_avatar(&avatar)
        });
        let sheet = tape_sheet(&TriMesh::default(), &SilhouetteMesh::new(&[]), &all);
        assert!(sheet.as_slice().iter().all(|p| *p == [250; 3]));
    }
}
