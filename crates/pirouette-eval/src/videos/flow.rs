//! Published comparison: the turn by keypoints, corrected by the optical flow on the trunk.
//!
//! Where the line of sight through the turning axis meets the trunk, the surface moves sideways by the turn times its
//! distance from the axis. The trunk is a circular or an elliptic cylinder, whose size is found by the keypoints: they show
//! how far the person turns in total.
//!
//! # Source
//! D. Baumgartner, T. Zucali and G. Zwettler 2020, "Hybrid Approach for Orientation-Estimation of Rotating Humans in
//! Video Frames Acquired by Stationary Monocular Camera": skeleton, flow at the spine, and an elliptical body. Details that
//! the paper does not state are ours.

use std::f64::consts::PI;
use std::ops::Range;

use pirouette::scan::Photo;
use pirouette::video::{TurnSample, TurnTrack};
use pirouette_body::{Joint, Keypoints};

/// Height of the trunk, from shoulders to hips, in statures
const TRUNK: f64 = 0.29;

/// Half of the width of the part of the trunk whose flow is measured, in statures
const HALF_WIDTH: f64 = 0.03;

/// Largest motion that is measured, in statures
const MAX_MOTION: f64 = 0.03;

/// Parts of the trunk's height whose motions are measured; the median counts
const BLOCKS: usize = 9;
const MIN_BLOCKS: usize = 3;

/// Mean squared gradient below which a block has no texture, in squared levels per px
const MIN_TEXTURE: f64 = 1.0;

/// Difference of the gradients relative to their squares above which a block has no counterpart: 1 if they are unrelated
const MAX_DIFFERENCE: f64 = 0.6;

/// Motion of the trunk between two frames
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TrunkMotion {
    /// Times of the frames, in s
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    /// Motion to the right of the surface in front of the turning axis, in statures
    pub(super) motion: f64,
}

/// Cross section of the trunk
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TrunkShape {
    Circular,
    Elliptic,
}

/// Returns the sideways motion of the trunk in front of the turning axis, in statures; `None` if it has no texture
pub(super) fn trunk_motion(before: &Photo, after: &Photo, keypoints: &Keypoints) -> Option<f64> {
    let middle = |left: Joint, right: Joint| {
        Some((keypoints.found(left)?.position + keypoints.found(right)?.position) / 2.0)
    };
    let shoulder = middle(Joint::LeftShoulder, Joint::RightShoulder)?;
    let hip = middle(Joint::LeftHip, Joint::RightHip)?;
    let height = hip.y - shoulder.y;
    let stature_px = height / TRUNK;
    let half = (HALF_WIDTH * stature_px).ceil() as isize;
    let most = (MAX_MOTION * stature_px).ceil() as isize;
    let x = ((shoulder.x + hip.x) / 2.0).round() as isize;
    let row_of = |block: usize| {
        let share = 0.1 + 0.85 * block as f64 / BLOCKS as f64;
        (shoulder.y + share * height) as isize
    };
    let rows = row_of(0)..row_of(BLOCKS);
    // Gradients reach two columns further.
    let columns = x - half - most - 2..x + half + most + 3;
    let inside = |range: &Range<isize>, size: usize| range.start >= 0 && range.end <= size as isize;
    if height <= 0.0
        || !inside(&columns, before.width().min(after.width()))
        || !inside(&rows, before.height().min(after.height()))
    {
        return None;
    }
    let mut motions: Vec<f64> = (0..BLOCKS)
        .filter_map(|block| {
            let rows = row_of(block)..row_of(block + 1);
            let first = gradients(before, rows.clone(), x - half..x + half + 1);
            let second = gradients(after, rows, x - half - most..x + half + most + 1);
            block_motion(&first, &second)
        })
        .collect();
    motions.sort_by(f64::total_cmp);
    (motions.len() >= MIN_BLOCKS).then(|| motions[motions.len() / 2] / stature_px)
}

/// Returns the horizontal gradients of gray values in each row, in levels per px
fn gradients(photo: &Photo, rows: Range<isize>, columns: Range<isize>) -> Vec<Vec<f64>> {
    rows.map(|y| {
        let row = photo.row(y as usize);
        let gray = |x: isize| row[x as usize].iter().map(|&v| f64::from(v)).sum::<f64>();
        let gradient = |x: isize| {
            // Sums of three channels at two pairs of pixels, which are 3 px apart on average
            (gray(x + 1) + gray(x + 2) - gray(x - 1) - gray(x - 2)) / 18.0
        };
        columns.clone().map(gradient).collect()
    })
    .collect()
}

/// Returns the shift of `first` in the middle of the wider `second`, in px; `None` without texture or counterpart
fn block_motion(first: &[Vec<f64>], second: &[Vec<f64>]) -> Option<f64> {
    let (width, wide) = (first.first()?.len(), second.first()?.len());
    let of_first: f64 = first.iter().flatten().map(|g| g * g).sum();
    if of_first < MIN_TEXTURE * (width * first.len()) as f64 {
        return None;
    }
    let difference = |shift: usize| {
        let (mut off, mut of_second) = (0.0, 0.0);
        for (a, b) in first.iter().zip(second) {
            for (a, b) in a.iter().zip(&b[shift..]) {
                off += (a - b) * (a - b);
                of_second += b * b;
            }
        }
        off / (of_first + of_second)
    };
    let differences: Vec<f64> = (0..=wide - width).map(difference).collect();
    let inner = 1..differences.len() - 1;
    let best = inner.min_by(|&a, &b| differences[a].total_cmp(&differences[b]))?;
    let [left, least, right] = [best - 1, best, best + 1].map(|i| differences[i]);
    if least > MAX_DIFFERENCE || least > left || least > right {
        return None;
    }
    let curvature = left - 2.0 * least + right;
    let fraction = if curvature > 0.0 {
        (left - right) / (2.0 * curvature)
    } else {
        0.0
    };
    Some(best as f64 - ((wide - width) / 2) as f64 + fraction)
}

/// Distance of the surface in front of the turning axis from it, by turn angle
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ellipse {
    /// Half of the width, in statures
    width: f64,
    /// Depth relative to the width
    ratio: f64,
}

impl Ellipse {
    fn distance(&self, angle: f64) -> f64 {
        let (sine, cosine) = angle.sin_cos();
        self.width * self.ratio / cosine.hypot(self.ratio * sine)
    }
}

/// Half of the width that is plausible, with arms before the trunk, in statures
const PLAUSIBLE_WIDTH: Range<f64> = 0.03..0.25;

/// Minimum turn over which the size of the trunk is found, in radians
const MIN_TURN: f64 = PI;

/// Standard deviation of a sample of the track, in degrees, as if its errors were independent
const SAMPLE_DEGREES: f64 = 9.0;

/// Standard deviation of the turn between two samples by the flow: in degrees, and relative to the turn
const STEP_DEGREES: f64 = 0.4;
const STEP_SHARE: f64 = 0.2;

/// Corrects a track by the motions of the trunk
///
/// The angles are most likely, given those of the track and, from each sample to the next, the turn by the flow. `None` if
/// the flow has nothing to do with the track, or the person turns by less than half a turn.
pub(super) fn with_flow(
    track: &TurnTrack,
    motions: &[TrunkMotion],
    shape: TrunkShape,
) -> Option<TurnTrack> {
    let (low, high) = track.range();
    let ellipse = fit_ellipse(track, motions, shape).filter(|_| high - low >= MIN_TURN)?;
    let tracked: Vec<f64> = track.samples.iter().map(|s| s.angle_radians).collect();
    let mut corrected = track.clone();
    // The distances depend on the angles.
    for _ in 0..3 {
        let steps: Vec<(f64, f64)> = corrected
            .samples
            .windows(2)
            .zip(tracked.windows(2))
            .map(|(pair, tracked)| {
                let by_flow = turn_by_flow(pair, motions, &ellipse);
                let turn = by_flow.unwrap_or(tracked[1] - tracked[0]);
                (
                    turn,
                    STEP_DEGREES.to_radians().hypot(STEP_SHARE * turn).powi(-2),
                )
            })
            .collect();
        let angles = most_likely(&tracked, SAMPLE_DEGREES.to_radians().powi(-2), &steps);
        for (sample, angle) in corrected.samples.iter_mut().zip(angles) {
            sample.angle_radians = angle;
        }
    }
    Some(corrected)
}

/// Finds the trunk by least squares of the motions; `None` if it is implausible
fn fit_ellipse(track: &TurnTrack, motions: &[TrunkMotion], shape: TrunkShape) -> Option<Ellipse> {
    /// Relative squared residual above which the flow is not that of the turn
    const MAX_RESIDUAL: f64 = 0.5;
    const RATIOS: usize = 30;
    let ratios = match shape {
        TrunkShape::Circular => RATIOS..=RATIOS,
        TrunkShape::Elliptic => 6..=RATIOS,
    };
    let fit = |step: usize| {
        let unit = Ellipse {
            width: 1.0,
            ratio: step as f64 / RATIOS as f64,
        };
        let (mut matrix, mut right, mut squares) = (0.0, 0.0, 0.0);
        for motion in motions {
            let (Some(from), Some(to)) =
                (track.angle_at(motion.from_s), track.angle_at(motion.to_s))
            else {
                continue;
            };
            let row = (to - from) * unit.distance((from + to) / 2.0);
            matrix += row * row;
            right += row * motion.motion;
            squares += motion.motion * motion.motion;
        }
        let width = right / matrix;
        let residual = (squares - width * right) / squares;
        residual
            .is_finite()
            .then_some((residual, Ellipse { width, ..unit }))
    };
    let (residual, ellipse) = ratios.filter_map(fit).min_by(|a, b| a.0.total_cmp(&b.0))?;
    let plausible = PLAUSIBLE_WIDTH.contains(&ellipse.width) && residual < MAX_RESIDUAL;
    plausible.then_some(ellipse)
}

/// Returns the turn from one sample to the next by the flow; `None` where there is none
fn turn_by_flow(pair: &[TurnSample], motions: &[TrunkMotion], ellipse: &Ellipse) -> Option<f64> {
    let (from, to) = (pair[0], pair[1]);
    let start = motions.partition_point(|motion| motion.from_s < from.time_s);
    let (mut motion, mut seen_s) = (0.0, 0.0);
    for part in motions[start..].iter().take_while(|m| m.to_s <= to.time_s) {
        motion += part.motion;
        seen_s += part.to_s - part.from_s;
    }
    let complete = seen_s > 0.99 * (to.time_s - from.time_s);
    let angle = (from.angle_radians + to.angle_radians) / 2.0;
    complete.then(|| motion / ellipse.distance(angle))
}

/// Returns the most likely angles, given each angle with a weight, and differences of neighbors with their weights
fn most_likely(angles: &[f64], weight: f64, differences: &[(f64, f64)]) -> Vec<f64> {
    let mut diagonal = vec![weight; angles.len()];
    let mut right: Vec<f64> = angles.iter().map(|angle| weight * angle).collect();
    for (i, (difference, weight)) in differences.iter().enumerate() {
        diagonal[i] += weight;
        diagonal[i + 1] += weight;
        right[i] -= weight * difference;
        right[i + 1] += weight * difference;
    }
    // Elimination: the off-diagonal elements are the negative weights of the differences.
    for (i, (_, weight)) in differences.iter().enumerate() {
        let share = weight / diagonal[i];
        diagonal[i + 1] -= share * weight;
        right[i + 1] += share * right[i];
    }
    let mut result = vec![0.0; angles.len()];
    for i in (0..angles.len()).rev() {
        let after = differences
            .get(i)
            .map_or(0.0, |(_, weight)| weight * result[i + 1]);
        result[i] = (right[i] + after) / diagonal[i];
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use pirouette_body::Keypoint;
    use std::f64::consts::TAU;

    fn keypoints() -> Keypoints {
        let mut keypoints = Keypoints::default();
        let joints = [
            (Joint::LeftShoulder, 130.0, 40.0),
            (Joint::RightShoulder, 70.0, 40.0),
            (Joint::LeftHip, 120.0, 156.0),
            (Joint::RightHip, 80.0, 156.0),
        ];
        for (joint, x, y) in joints {
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

    fn cloth(shift: f64) -> Photo {
        Photo::from_fn(200, 200, |x, y| {
            let x = x as f64 - shift;
            let wave = (x / 2.3 + y as f64 / 9.0).sin() + (x / 3.7 - y as f64 / 5.0).sin();
            [(128.0 + 40.0 * wave) as u8; 3]
        })
    }

    #[test]
    fn motion_is_measured_to_a_fraction_of_a_pixel() {
        for shift in [-6.0, -1.5, 0.0, 0.3, 4.7] {
            let found = trunk_motion(&cloth(0.0), &cloth(shift), &keypoints()).unwrap();
            let found_px = found * 116.0 / TRUNK;
            assert!((found_px - shift).abs() < 0.15, "{shift}: {found_px}");
        }
        let plain = Photo::filled(200, 200, [90; 3]);
        assert_eq!(trunk_motion(&plain, &plain, &keypoints()), None);
        let small = Photo::filled(100, 100, [90; 3]);
        assert_eq!(trunk_motion(&small, &small, &keypoints()), None);
    }

    /// Returns a track with an error and the motions of an elliptic trunk, 10 times a second for 10 s
    fn turn(error: impl Fn(f64) -> f64) -> (TurnTrack, Vec<TrunkMotion>, Vec<f64>) {
        let ellipse = Ellipse {
            width: 0.1,
            ratio: 0.7,
        };
        let truth: Vec<f64> = (0..=100).map(|i| TAU * f64::from(i) / 100.0).collect();
        let samples = truth.iter().enumerate().map(|(i, angle)| TurnSample {
            time_s: i as f64 / 10.0,
            angle_radians: angle + error(*angle),
        });
        let motions = truth.windows(2).enumerate().map(|(i, pair)| TrunkMotion {
            from_s: i as f64 / 10.0,
            to_s: (i + 1) as f64 / 10.0,
            motion: (pair[1] - pair[0]) * ellipse.distance((pair[0] + pair[1]) / 2.0),
        });
        let track = TurnTrack {
            samples: samples.collect(),
        };
        let motions = motions.collect();
        (track, motions, truth)
    }

    #[test]
    fn flow_on_an_ellipse_corrects_errors_of_keypoints() {
        let (track, motions, truth) = turn(|angle| 0.05 * (5.0 * angle).sin());
        let off = |track: &TurnTrack| {
            let pairs = track.samples.iter().zip(&truth);
            let squares = pairs.map(|(sample, truth)| (sample.angle_radians - truth).powi(2));
            (squares.sum::<f64>() / truth.len() as f64).sqrt()
        };
        let elliptic = with_flow(&track, &motions, TrunkShape::Elliptic).unwrap();
        let circular = with_flow(&track, &motions, TrunkShape::Circular).unwrap();
        assert!(
            off(&elliptic) < 0.5 * off(&track),
            "{} {}",
            off(&elliptic),
            off(&track)
        );
        assert!(off(&elliptic) < off(&circular), "{}", off(&circular));
    }

    #[test]
    fn flow_that_has_nothing_to_do_with_the_turn_is_not_used() {
        let (track, mut motions, _) = turn(|_| 0.0);
        for (i, motion) in motions.iter_mut().enumerate() {
            motion.motion = 0.01 * (i as f64 * 1.7).sin();
        }
        assert_eq!(with_flow(&track, &motions, TrunkShape::Elliptic), None);
        assert_eq!(with_flow(&track, &[], TrunkShape::Elliptic), None);
    }

    #[test]
    fn the_most_likely_angles_solve_the_normal_equations() {
        let (angles, weight) = ([0.1, 0.5, 0.2, 0.9], 2.0);
        let differences = [(0.3, 5.0), (0.1, 1.0), (0.2, 7.0)];
        let found = most_likely(&angles, weight, &differences);
        for i in 0..4 {
            let mut gradient = weight * (found[i] - angles[i]);
            if let Some((difference, weight)) = differences.get(i) {
                gradient -= weight * (found[i + 1] - found[i] - difference);
            }
            if i > 0 {
                let (difference, weight) = differences[i - 1];
                gradient += weight * (found[i] - found[i - 1] - difference);
            }
            assert!(gradient.abs() < 1e-12, "{i}: {gradient}");
        }
    }
}
