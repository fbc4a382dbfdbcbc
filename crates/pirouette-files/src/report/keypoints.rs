//! The keypoints of one photo, with the name of every joint.

use glam::DVec2;

use super::SKELETON_LINES;
use super::canvas::{Color, disc, paste, stroke};
use super::font::Lettering;
use super::labels::spread;
use pirouette::scan::Photo;
use pirouette_body::{Joint, Keypoints, PerJoint};

/// Colors of the person's left, the person's right, and of joints in the middle
const LEFT_COLOR: Color = [255, 150, 30];
const RIGHT_COLOR: Color = [60, 165, 255];
const MIDDLE_COLOR: Color = [235, 238, 242];

const PANEL: Color = [16, 18, 22];

/// Photo height for which the line widths are given, in px
const NOMINAL_HEIGHT_PX: f64 = 1000.0;

const LINE_PX: f64 = 3.0;
const JOINT_PX: f64 = 4.5;
const LEADER_PX: f64 = 1.0;

/// Size of the text, as a fraction of the photo's longer side, and its minimum in px
const TEXT_SIZE: f64 = 0.019;
const MIN_TEXT_PX: f64 = 10.0;

/// Space around a label, relative to the size of the text
const PADDING: f64 = 0.5;

/// A found joint in the picture
struct Label {
    joint: Joint,
    anchor: DVec2,
}

/// Draws the skeleton over a photo, with the names of the joints in columns to the left and right of the photo
///
/// `keypoints` are in px of the photo; joints that are not found are omitted. Colors distinguish the person's left from
/// the person's right. The picture is wider than the photo by the columns.
pub fn keypoint_picture(photo: &Photo, keypoints: &Keypoints) -> Photo {
    let longer = photo.width().max(photo.height()) as f64;
    let mut lettering = Lettering::new((TEXT_SIZE * longer).max(MIN_TEXT_PX));
    let padding = (PADDING * lettering.size_px()).ceil() as usize;
    let names = Joint::ALL.iter();
    let widest = names.map(|&joint| lettering.width(&label_text(joint)));
    let column_px = widest.max().unwrap_or(0) + 2 * padding;
    let width = photo.width() + 2 * column_px;
    let mut picture = Photo::filled(width, photo.height(), PANEL);
    paste(&mut picture, photo, (column_px, 0));

    let unit = (photo.height() as f64 / NOMINAL_HEIGHT_PX).max(0.6);
    let corner = DVec2::new(column_px as f64, 0.0);
    let positions = PerJoint::from_fn(|joint| {
        let keypoint = keypoints.found(joint)?;
        let position = keypoint.position + corner;
        position.is_finite().then_some(position)
    });
    for [a, b] in SKELETON_LINES {
        if let (Some(from), Some(to)) = (positions[a], positions[b]) {
            let color = if color(a) == MIDDLE_COLOR {
                color(b)
            } else {
                color(a)
            };
            stroke(&mut picture, &[[from, to]], LINE_PX * unit, color);
        }
    }
    let mut labels: Vec<Label> = Joint::ALL
        .iter()
        .filter_map(|&joint| {
            let anchor = positions[joint]?;
            Some(Label { joint, anchor })
        })
        .collect();
    labels.sort_by(|a, b| a.anchor.x.total_cmp(&b.anchor.x));
    let right = labels.split_off(labels.len() / 2);
    for (mut column, on_the_right) in [(labels, false), (right, true)] {
        column.sort_by(|a, b| a.anchor.y.total_cmp(&b.anchor.y));
        draw_column(
            &mut picture,
            &mut lettering,
            &column,
            (column_px, padding),
            on_the_right,
            unit,
        );
    }
    for &joint in &Joint::ALL {
        if let Some(position) = positions[joint] {
            disc(&mut picture, position, JOINT_PX * unit, color(joint));
        }
    }
    picture
}

/// Draws the labels of one side, from top to bottom, and the lines from them to their joints
fn draw_column(
    picture: &mut Photo,
    lettering: &mut Lettering,
    labels: &[Label],
    (column_px, padding): (usize, usize),
    on_the_right: bool,
    unit: f64,
) {
    let line = lettering.line_px();
    let wanted: Vec<f64> = labels
        .iter()
        .map(|label| label.anchor.y - line as f64 / 2.0)
        .collect();
    let tops = spread(&wanted, &vec![line; labels.len()], picture.height());
    let edge = if on_the_right {
        picture.width() - column_px
    } else {
        column_px
    };
    for (label, top) in labels.iter().zip(tops) {
        let text = label_text(label.joint);
        let left = if on_the_right {
            edge + padding
        } else {
            edge.saturating_sub(padding + lettering.width(&text))
        };
        let start = DVec2::new(edge as f64, (top + line / 2) as f64 + 0.5);
        let color = color(label.joint);
        stroke(picture, &[[start, label.anchor]], LEADER_PX * unit, color);
        lettering.draw(picture, (left, top), &text, color);
    }
}

fn label_text(joint: Joint) -> String {
    joint.name().replace('_', " ")
}

/// Returns the color of the side of a joint
fn color(joint: Joint) -> Color {
    if joint.mirrored() == joint {
        MIDDLE_COLOR
    } else if joint.name().starts_with("left") {
        LEFT_COLOR
    } else {
        RIGHT_COLOR
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_body::Keypoint;

    fn at(points: &[(Joint, f64, f64)]) -> Keypoints {
        let keypoint = |&(joint, x, y)| {
            let position = DVec2::new(x, y);
            (
                joint,
                Keypoint {
                    position,
                    confidence: 0.6,
                },
            )
        };
        points.iter().map(keypoint).collect()
    }

    #[test]
    fn left_and_right_have_their_own_colors() {
        let photo = Photo::filled(400, 600, [100; 3]);
        let keypoints = at(&[
            (Joint::LeftKnee, 300.5, 300.5),
            (Joint::LeftAnkle, 300.5, 500.5),
            (Joint::RightKnee, 100.5, 300.5),
            (Joint::MidHip, 200.5, 100.5),
        ]);
        let picture = keypoint_picture(&photo, &keypoints);
        let column = (picture.width() - photo.width()) / 2;
        assert_eq!(picture.height(), 600);
        assert_eq!(picture[(column + 300, 300)], LEFT_COLOR);
        assert_eq!(picture[(column + 300, 400)], LEFT_COLOR);
        assert_eq!(picture[(column + 100, 300)], RIGHT_COLOR);
        assert_eq!(picture[(column + 200, 100)], MIDDLE_COLOR);
        // Labels are beside the photo, two on each side; thin strokes of small text do not fill a pixel.
        let has_text = |left: usize, color: Color| {
            let written = |x: usize, y: usize| {
                let channels = (0..3).map(|channel| {
                    let [pixel, from, to] =
                        [picture[(x, y)], PANEL, color].map(|c| f64::from(c[channel]));
                    (pixel - from) / (to - from)
                });
                let coverage: Vec<f64> = channels.collect();
                coverage
                    .iter()
                    .all(|c| *c > 0.5 && (c - coverage[0]).abs() < 0.1)
            };
            (0..600).any(|y| (left..left + column).any(|x| written(x, y)))
        };
        let (left, right) = (0, column + 400);
        assert!(has_text(left, RIGHT_COLOR) && has_text(left, MIDDLE_COLOR));
        assert!(has_text(right, LEFT_COLOR));
        assert!(!has_text(left, LEFT_COLOR));
        assert!(!has_text(right, RIGHT_COLOR) && !has_text(right, MIDDLE_COLOR));
    }

    #[test]
    fn all_photos_and_positions_are_accepted() {
        let wild = at(&[
            (Joint::Nose, 1e18, -1e18),
            (Joint::Neck, f64::NAN, 1.0),
            (Joint::LeftKnee, f64::INFINITY, 1.0),
        ]);
        for (width, height) in [(0, 0), (1, 1), (1, 50), (300, 20)] {
            let photo = Photo::filled(width, height, [1; 3]);
            for keypoints in [wild, Keypoints::default()] {
                let picture = keypoint_picture(&photo, &keypoints);
                assert!(picture.width() > width && picture.height() == height);
            }
        }
    }
}
