//! The overlay: the results of one view, drawn over its photo.

use glam::DVec2;
use pirouette_geom::contour::trace_windowed;
use pirouette_geom::{Grid, Windowed};
use pirouette_segment::seeds::Seed;

use super::canvas::{Color, Tint, disc, stroke, tint_box};
use super::font::Lettering;
use super::labels::{Entry, Legend};
use super::{CONTOUR_COLOR, DETECTED_COLOR, SKELETON_LINES, TARGET_COLOR};
use pirouette::scan::Photo;
use pirouette_body::{Keypoints, PerJoint};

/// Contents of an overlay; `None` is not drawn
#[derive(Debug, Clone, Copy)]
pub struct OverlayInput<'a> {
    /// The photo
    pub photo: &'a Photo,
    /// The seeds of the segmentation, size of the photo
    pub seeds: Option<&'a Grid<Seed>>,
    /// The silhouette as coverage, size of the photo; its contour at the level 0.5 is drawn
    pub silhouette: Option<&'a Windowed<f32>>,
    /// The detected skeleton
    pub detected: &'a Keypoints,
    /// The joints of the reference skeleton, in px of the photo
    pub target: Option<&'a PerJoint<DVec2>>,
}

/// Tints of the seeds, with their strength; certain background is not tinted
const PERSON_TINT: (Color, f64) = ([40, 210, 90], 0.34);
const PROBABLE_PERSON_TINT: (Color, f64) = ([120, 220, 160], 0.22);
const PROBABLE_BACKGROUND_TINT: (Color, f64) = ([250, 150, 60], 0.22);

/// Photo height for which the line widths are given, in px
const NOMINAL_HEIGHT_PX: f64 = 1000.0;

/// Draws seeds, outline, the detected and the target skeleton over a photo, with a legend
///
/// Keypoints up to a confidence of [`SURE_CONFIDENCE`] are drawn as small dots. Seeds or silhouettes of another size
/// than the photo are not drawn.
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
    let found = PerJoint::from_fn(|joint| input.detected.found(joint));
    let positions = found.map(|keypoint| keypoint.map(|k| k.position));
    draw_skeleton(&mut photo, &positions, 2.0 * unit, DETECTED_COLOR);
    for keypoint in found.into_iter().flatten() {
        let sure = keypoint.confidence > SURE_CONFIDENCE;
        let radius = if sure { 4.0 } else { 2.5 } * unit;
        disc(&mut photo, keypoint.position, radius, DETECTED_COLOR);
    }

    let mut entries = vec![("Detected joints", DETECTED_COLOR)];
    if input.target.is_some() {
        entries.push(("Target joints", TARGET_COLOR));
    }
    if silhouette.is_some() {
        entries.push(("Outline", CONTOUR_COLOR));
    }
    if seeds.is_some() {
        entries.push(("Certainly person", PERSON_TINT.0));
        entries.push(("Probably person", PROBABLE_PERSON_TINT.0));
        entries.push(("Probably background", PROBABLE_BACKGROUND_TINT.0));
    }
    draw_legend(&mut photo, &entries, silhouette);
    photo
}

/// Keypoints above this confidence (0 to 1) are drawn large
pub const SURE_CONFIDENCE: f64 = 0.5;

fn draw_skeleton(photo: &mut Photo, joints: &PerJoint<Option<DVec2>>, width: f64, color: Color) {
    let lines: Vec<[DVec2; 2]> = SKELETON_LINES
        .iter()
        .filter_map(|[a, b]| Some([joints[*a]?, joints[*b]?]))
        .collect();
    stroke(photo, &lines, width, color);
}

/// Size of the legend's text, as a fraction of the longer side of the photo
///
/// The page shows overlays at 900 px, which gives text of 17 px.
const TEXT_SIZE: f64 = 0.019;

/// Minimum size of readable text, in px
const MIN_TEXT_PX: f64 = 9.0;

/// Maximum share of the columns and rows for the legend, unless its text would become too small
const LEGEND_EXTENT: (f64, f64) = (0.4, 0.3);

/// Padding of the legend, relative to the size of the text
const PADDING: f64 = 0.6;

const PANEL: Color = [16, 18, 22];
const PANEL_OPACITY: f64 = 0.76;
const PANEL_INK: Color = [240, 242, 244];

/// Draws the legend in the corner with the fewest silhouette pixels; omitted if the photo is too small for it
fn draw_legend(photo: &mut Photo, entries: &[(&str, Color)], silhouette: Option<&Windowed<f32>>) {
    let photo_size = (photo.width(), photo.height());
    let preferred = (TEXT_SIZE * photo_size.0.max(photo_size.1) as f64).max(MIN_TEXT_PX);
    let (_, _, (width, height)) = set_legend(entries, preferred);
    let shrink_to_extent = (LEGEND_EXTENT.0 * photo_size.0 as f64 / width as f64)
        .min(LEGEND_EXTENT.1 * photo_size.1 as f64 / height as f64)
        .min(1.0);
    let text_px = (preferred * shrink_to_extent).max(MIN_TEXT_PX);
    let (legend, mut lettering, size) = set_legend(entries, text_px);
    if size.0 > photo_size.0 || size.1 > photo_size.1 {
        return;
    }
    let (right, bottom) = (photo_size.0 - size.0, photo_size.1 - size.1);
    let corners = [(0, 0), (right, 0), (0, bottom), (right, bottom)];
    let hidden = |corner: &(usize, usize)| silhouette.map_or(0, |s| inside_count(s, *corner, size));
    let Some(corner) = corners.into_iter().min_by_key(hidden) else {
        return;
    };
    tint_box(photo, corner, size, PANEL, PANEL_OPACITY);
    let padding = padding_px(&lettering);
    let start = (corner.0 + padding, corner.1 + padding);
    legend.draw(photo, start, &mut lettering, PANEL_INK);
}

/// Creates a legend of one entry per line; returns it with its lettering and the size of its panel
fn set_legend(entries: &[(&str, Color)], text_px: f64) -> (Legend, Lettering, (usize, usize)) {
    let mut lettering = Lettering::new(text_px);
    let lines = entries
        .iter()
        .map(|&(text, color)| vec![Entry::swatch(color, text)]);
    let legend = Legend::new(lines.collect(), &mut lettering, usize::MAX);
    let padding = padding_px(&lettering);
    let size = (legend.size.0 + 2 * padding, legend.size.1 + 2 * padding);
    (legend, lettering, size)
}

fn padding_px(lettering: &Lettering) -> usize {
    (PADDING * lettering.size_px()).ceil() as usize
}

/// Counts the pixels of a box inside the silhouette, on every fourth row
fn inside_count(
    silhouette: &Windowed<f32>,
    (left, top): (usize, usize),
    (width, height): (usize, usize),
) -> usize {
    let (window, (x0, y0)) = (silhouette.window(), silhouette.corner());
    let start = left.saturating_sub(x0).min(window.width());
    let end = (left + width).saturating_sub(x0).min(window.width());
    let rows = top.saturating_sub(y0)..(top + height).saturating_sub(y0).min(window.height());
    rows.step_by(4)
        .map(|y| {
            let row = &window.row(y)[start..end];
            row.iter().filter(|&&coverage| coverage >= 0.5).count()
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_body::{Joint, Keypoint};

    fn keypoints(points: &[(Joint, f64, f64)]) -> Keypoints {
        let keypoint = |&(joint, x, y)| {
            let position = DVec2::new(x, y);
            (
                joint,
                Keypoint {
                    position,
                    confidence: 0.9,
                },
            )
        };
        points.iter().map(keypoint).collect()
    }

    #[test]
    fn each_element_is_drawn_in_its_color() {
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
        let target = PerJoint::splat(DVec2::new(150.0, 380.0));
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
        assert_eq!(
            drawn[(230, 200)],
            [100; 3],
            "the rest of the photo is unchanged"
        );
    }

    #[test]
    fn the_legend_avoids_the_person_and_fits_small_photos() {
        let detected = keypoints(&[]);
        for (width, height) in [(200, 250), (250, 200), (800, 1000)] {
            let photo = Photo::filled(width, height, [100; 3]);
            let upper_left = |x: usize, y: usize| x < width * 3 / 5 && y < height * 3 / 4;
            let silhouette =
                Grid::from_fn(width, height, |x, y| f32::from(u8::from(upper_left(x, y))));
            let drawn = overlay(&OverlayInput {
                photo: &photo,
                seeds: None,
                silhouette: Some(&Windowed::new(&silhouette)),
                detected: &detected,
                target: None,
            });
            // The outline is drawn over the border: pixels 5 px inside the person are unchanged.
            let inside = |x, y| upper_left(x + 5, y + 5) && x >= 5 && y >= 5;
            let unchanged = |x, y| !inside(x, y) || drawn[(x, y)] == [100; 3];
            assert!((0..height).all(|y| (0..width).all(|x| unchanged(x, y))));
            let corners = [(width - 1, 0), (0, height - 1), (width - 1, height - 1)];
            let panels = corners.into_iter().filter(|&corner| drawn[corner][0] < 50);
            assert_eq!(panels.count(), 1, "one panel in {width}x{height}");
        }
    }

    #[test]
    fn unusual_sizes_and_invalid_joints_are_accepted() {
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
                target: Some(&PerJoint::splat(DVec2::NAN)),
            });
            assert!(drawn.same_size(&photo));
        }
    }
}
