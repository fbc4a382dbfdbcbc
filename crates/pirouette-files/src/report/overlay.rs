//! One photo with all that was found in it drawn over.

use glam::DVec2;
use pirouette_geom::contour::trace_windowed;
use pirouette_geom::{Grid, Windowed};
use pirouette_segment::seeds::Seed;

use super::canvas::{self, Color, Tint, disc, stroke, tint_box};
use super::{CONTOUR_COLOR, DETECTED_COLOR, SKELETON_LINES, TARGET_COLOR};
use pirouette::scan::Photo;
use pirouette_body::{Joint, Keypoints};

/// What an overlay shows; what is missing is left out
#[derive(Debug, Clone, Copy)]
pub struct OverlayInput<'a> {
    /// The photo
    pub photo: &'a Photo,
    /// What the segmentation was told, size of the photo
    pub seeds: Option<&'a Grid<Seed>>,
    /// The silhouette as coverage, size of the photo; its half level is drawn
    pub silhouette: Option<&'a Windowed<f32>>,
    /// The skeleton as detected
    pub detected: &'a Keypoints,
    /// Where the joints are to go, in px of the photo
    pub target: Option<&'a [DVec2; Joint::COUNT]>,
}

/// Tints of the seeds, with their strength; sure background is left as it is
const PERSON_TINT: (Color, f64) = ([40, 210, 90], 0.34);
const PROBABLE_PERSON_TINT: (Color, f64) = ([120, 220, 160], 0.22);
const PROBABLE_BACKGROUND_TINT: (Color, f64) = ([250, 150, 60], 0.22);

/// Line widths and text are made for photos of this height, in px
const NOMINAL_HEIGHT_PX: f64 = 1000.0;

/// Draws seeds, outline, the detected and the target skeleton over a photo, with a legend
///
/// Doubtful keypoints (below [`SURE_CONFIDENCE`]) are drawn as small dots. Seeds or silhouettes of another size
/// than the photo are left out.
pub fn overlay(input: &OverlayInput) -> Photo {
    let mut photo = input.photo.clone();
    let unit = (photo.height() as f64 / NOMINAL_HEIGHT_PX).max(0.6);
    let seeds = input.seeds.filter(|seeds| seeds.same_size(&photo));
    if let Some(seeds) = seeds {
        let [person, probably, doubtful] =
            [PERSON_TINT, PROBABLE_PERSON_TINT, PROBABLE_BACKGROUND_TINT]
                .map(|(color, alpha)| Tint::new(color, alpha));
        for (pixel, seed) in photo.as_mut_slice().iter_mut().zip(seeds.as_slice()) {
            match seed {
                Seed::Background => {}
                Seed::ProbableBackground => doubtful.apply(pixel),
                Seed::ProbablePerson => probably.apply(pixel),
                Seed::Person => person.apply(pixel),
            }
        }
    }
    let silhouette = input
        .silhouette
        .filter(|s| (s.width(), s.height()) == (photo.width(), photo.height()));
    if let Some(silhouette) = silhouette {
        let edges: Vec<[DVec2; 2]> = trace_windowed(silhouette, 0.5)
            .iter()
            .flat_map(|contour| contour.edges().collect::<Vec<_>>())
            .collect();
        stroke(&mut photo, &edges, 2.0 * unit, CONTOUR_COLOR);
    }
    if let Some(target) = input.target {
        draw_skeleton(&mut photo, &target.map(Some), 3.0 * unit, TARGET_COLOR);
        for &joint in target {
            disc(&mut photo, joint, 3.0 * unit, TARGET_COLOR);
        }
    }
    let found = Joint::ALL.map(|joint| input.detected.found(joint));
    let positions = found.map(|keypoint| keypoint.map(|k| k.position));
    draw_skeleton(&mut photo, &positions, 2.0 * unit, DETECTED_COLOR);
    for keypoint in found.into_iter().flatten() {
        let sure = keypoint.confidence > SURE_CONFIDENCE;
        let radius = if sure { 4.0 } else { 2.5 } * unit;
        disc(&mut photo, keypoint.position, radius, DETECTED_COLOR);
    }

    let mut entries = vec![("detected joints", DETECTED_COLOR)];
    if input.target.is_some() {
        entries.push(("target joints", TARGET_COLOR));
    }
    if silhouette.is_some() {
        entries.push(("outline", CONTOUR_COLOR));
    }
    if seeds.is_some() {
        entries.push(("surely person", PERSON_TINT.0));
        entries.push(("probably person", PROBABLE_PERSON_TINT.0));
        entries.push(("probably background", PROBABLE_BACKGROUND_TINT.0));
    }
    legend(&mut photo, &entries, unit);
    photo
}

/// Keypoints above this confidence (0 to 1) are drawn large
pub const SURE_CONFIDENCE: f64 = 0.5;

fn draw_skeleton(
    photo: &mut Photo,
    joints: &[Option<DVec2>; Joint::COUNT],
    width: f64,
    color: Color,
) {
    let lines: Vec<[DVec2; 2]> = SKELETON_LINES
        .iter()
        .filter_map(|[a, b]| Some([joints[*a as usize]?, joints[*b as usize]?]))
        .collect();
    stroke(photo, &lines, width, color);
}

/// Names what the colors mean, in the upper left corner; left out where the photo is too small for it
fn legend(photo: &mut Photo, entries: &[(&str, Color)], unit: f64) {
    let scale = (1.6 * unit).round().max(1.0) as usize;
    let line = 11 * scale;
    let sizes = entries
        .iter()
        .map(|(text, _)| canvas::text_size(text, scale));
    let text_width = sizes.map(|size| size.0).max().unwrap_or(0);
    let (swatch, margin) = (12 * scale, 4 * scale);
    let width = text_width + swatch + 3 * margin;
    let height = entries.len() * line + 2 * margin;
    if width > photo.width() || height > photo.height() {
        return;
    }
    tint_box(photo, (0, 0), (width, height), [16, 18, 22], 0.72);
    for (i, &(text, color)) in entries.iter().enumerate() {
        let top = margin + i * line;
        let bar = (margin, top + 2 * scale);
        tint_box(photo, bar, (swatch, 4 * scale), color, 1.0);
        let left = 2 * margin + swatch;
        canvas::write(photo, (left, top), text, scale, [236, 238, 240]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_body::Keypoint;

    fn keypoints(points: &[(Joint, f64, f64)]) -> Keypoints {
        let mut keypoints = Keypoints::default();
        for &(joint, x, y) in points {
            let position = DVec2::new(x, y);
            let confidence = 0.9;
            keypoints.set(
                joint,
                Keypoint {
                    position,
                    confidence,
                },
            );
        }
        keypoints
    }

    #[test]
    fn everything_leaves_its_color_where_it_belongs() {
        let (width, height) = (300, 400);
        let photo = Photo::filled(width, height, [100; 3]);
        let seeds = Grid::from_fn(width, height, |x, y| match (x, y) {
            (200..220, 300..320) => Seed::Person,
            _ => Seed::Background,
        });
        let silhouette = Grid::from_fn(width, height, |x, _| f32::from(u8::from(x >= 250)));
        let detected = keypoints(&[
            (Joint::LeftKnee, 60.5, 250.0),
            (Joint::LeftAnkle, 60.5, 350.0),
        ]);
        let target = [DVec2::new(150.0, 380.0); Joint::COUNT];
        let drawn = overlay(&OverlayInput {
            photo: &photo,
            seeds: Some(&seeds),
            silhouette: Some(&Windowed::new(&silhouette)),
            detected: &detected,
            target: Some(&target),
        });
        assert!(drawn.same_size(&photo));
        assert_eq!(drawn[(60, 300)], DETECTED_COLOR);
        assert_eq!(drawn[(150, 380)], TARGET_COLOR);
        let outline = drawn[(250, 200)];
        assert!(outline[0] > 180 && outline[2] < 100, "{outline:?}");
        let seeded = drawn[(210, 310)];
        assert!(seeded[1] > seeded[0] && seeded[1] > seeded[2], "{seeded:?}");
        assert_eq!(drawn[(230, 200)], [100; 3], "elsewhere the photo stays");
    }

    #[test]
    fn odd_sizes_and_wild_joints_do_not_break_it() {
        let wild = keypoints(&[
            (Joint::Nose, 1e18, -1e18),
            (Joint::Neck, f64::NAN, 1.0),
            (Joint::MidHip, 0.0, 0.0),
        ]);
        let seeds = Grid::filled(2, 2, Seed::Person);
        for (width, height) in [(0, 0), (1, 1), (1, 50)] {
            let photo = Photo::filled(width, height, [1; 3]);
            let drawn = overlay(&OverlayInput {
                photo: &photo,
                seeds: Some(&seeds),
                silhouette: None,
                detected: &wild,
                target: Some(&[DVec2::NAN; Joint::COUNT]),
            });
            assert!(drawn.same_size(&photo));
        }
    }
}
