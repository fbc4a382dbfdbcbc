//! The body, front and side, with every tape drawn where it was taken.

use glam::{DVec2, DVec3};
use pirouette_geom::TriMesh;

use super::canvas::{self, Color, paste, stroke};
use pirouette::measure::{Girth, Measure, Measurements};
use pirouette::scan::Photo;
use pirouette_body::Camera;
use pirouette_body::TurnAngle;
use pirouette_body::render::{SilhouetteMesh, shade};

/// Columns and rows of each of the two pictures
const TILE_PX: (usize, usize) = (700, 1000);

/// Columns for the labels beside them
const LABEL_WIDTH_PX: usize = 430;

const TAPE_COLOR: Color = [214, 40, 57];
const HIDDEN_COLOR: Color = [240, 170, 170];
const INK: Color = [30, 30, 30];
const TEXT_SCALE: usize = 2;
const LINE_PX: f64 = 3.0;

/// Draws a body from the front and from its right side, tapes in red, pale where the body hides them, with their lengths
///
/// `body` is in the world frame, mm; `mesh` is made of its triangles. A body without area gives an empty sheet.
pub fn tape_sheet(body: &TriMesh, mesh: &SilhouetteMesh, measurements: &Measurements) -> Photo {
    let (width, height) = TILE_PX;
    let mut sheet = Photo::filled(2 * width + LABEL_WIDTH_PX, height, [250; 3]);
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
    let (front, side) = rayon::join(|| from(0.0), || from(90.0));
    paste(&mut sheet, &front, (0, 0));
    paste(&mut sheet, &side, (width, 0));
    let labels = measurements.tapes.iter().filter_map(|(girth, curve)| {
        let top = curve.iter().map(|p| p.y).sum::<f64>() / curve.len() as f64;
        let row = camera.project(DVec3::Y * top).y;
        Some((row, label(*girth, measurements)?))
    });
    let mut label_rows: Vec<(f64, String)> = labels.collect();
    label_rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    let line = canvas::text_size("", TEXT_SCALE).1 as f64 + 4.0;
    let mut free = 10.0;
    for (y, text) in label_rows {
        let top = f64::max(free, y - line / 2.0).min(height as f64 - line);
        let left = 2 * width + 12;
        canvas::write(&mut sheet, (left, top as usize), &text, TEXT_SCALE, INK);
        free = top + line;
    }
    sheet
}

/// A camera that stands so far away that nearer tapes look no larger
fn far_camera(low: DVec3, high: DVec3) -> Camera {
    const DISTANCE_STATURES: f64 = 6.0;
    let stature = high.y - low.y;
    let (width_px, height_px) = TILE_PX;
    let span = high.abs().max(low.abs());
    let wide = 2.0 * span.x.max(span.z) * height_px as f64 / width_px as f64;
    let seen = 1.08 * stature.max(wide);
    Camera {
        width_px,
        height_px,
        vertical_fov_radians: 2.0 * (seen / 2.0 / (DISTANCE_STATURES * stature)).atan(),
        height_mm: (low.y + high.y) / 2.0,
        distance_mm: DISTANCE_STATURES * stature,
        pitch_radians: 0.0,
    }
}

/// Strokes the far half of a tape pale, the near half over it
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

/// Name and length of a tape; of two limbs the left one speaks for both
fn label(girth: Girth, measurements: &Measurements) -> Option<String> {
    let measure = Measure::ALL
        .into_iter()
        .find(|m| m.girths().first() == Some(&girth))?;
    let value_mm = measurements.value_mm(measure)?;
    let name = measure.name().replace('_', " ");
    Some(format!("{name} {}", measurements.told(value_mm).trim()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette::measure::{MeasureInput, measure};
    use pirouette::scan::{StatureFrom, Subject};
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    #[test]
    fn tapes_are_drawn_on_both_pictures_and_labelled() {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let all = measure(&MeasureInput {
            body: &avatar.mesh,
            avatar: &avatar,
            fitted: true,
            views: &[],
            stature_mm: Some(1700.0),
            stature_from: StatureFrom::Stated,
            subject: Subject::default(),
            given_masks: 1.0,
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
        let (width, _) = TILE_PX;
        assert!(count(0..width, TAPE_COLOR) > 2000);
        assert!(count(width..2 * width, TAPE_COLOR) > 1000);
        assert!(count(2 * width..sheet.width(), INK) > 1000);
        // The waist's tape crosses the middle of the front at its height.
        let camera = far_camera(DVec3::ZERO, DVec3::new(0.0, 1700.0, 0.0));
        assert!(camera.distance_mm > 9000.0);
    }

    #[test]
    fn nothing_gives_an_empty_sheet() {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let all = measure(&MeasureInput {
            body: &TriMesh::default(),
            avatar: &avatar,
            fitted: true,
            views: &[],
            stature_mm: None,
            stature_from: StatureFrom::Stated,
            subject: Subject::default(),
            given_masks: 1.0,
        });
        let sheet = tape_sheet(&TriMesh::default(), &SilhouetteMesh::new(&[]), &all);
        assert!(sheet.as_slice().iter().all(|p| *p == [250; 3]));
    }
}
