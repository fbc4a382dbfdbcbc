//! The turn angle over time, by the keypoints of many frames.
//!
//! In one frame, the distances of left from right shoulder and hip give the cosine of the turn angle, those of toes from
//! heels its sine: each relative to its range in the video. The angles of successive frames
//! are then continued beyond full turns, and smoothed over time by robust local lines.

use std::f64::consts::{PI, TAU};

use pirouette_body::{Joint, Keypoints, TurnAngle};
use thiserror::Error;

/// Time on each side over which angles are smoothed, in s
const REACH_S: f64 = 0.6;

/// Deviation from the local line beyond which a sample is ignored, in radians
const OUTLIER_RADIANS: f64 = 0.5;

/// Minimum number of samples of a track
const MIN_SAMPLES: usize = 8;

/// Usual largest distances of left from right and of toes from heels, in statures
const USUAL: [f64; 2] = [0.18, 0.12];

/// Quantile of the distances that counts as the largest one
const LARGEST: f64 = 0.92;

/// Distance of the person from the usual place that is elsewhere, in statures
const ELSEWHERE: f64 = 0.15;

/// Relative difference from the usual size that is elsewhere
const OTHER_SIZE: f64 = 0.12;

/// A turn angle at a time
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnSample {
    /// Time since the start of the video, in s
    pub time_s: f64,
    /// Turn angle, continued beyond full turns: 0 and multiples of a turn face the camera
    pub angle_radians: f64,
}

/// The turn angle over time
#[derive(Debug, Clone, PartialEq)]
pub struct TurnTrack {
    /// In order of time, while the person is at the turning axis
    pub samples: Vec<TurnSample>,
}

/// Why there is no turn
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum TrackError {
    /// There is no person
    #[error("no person is found in the video; film one person from head to toe")]
    NoPerson,
    /// The person is seen too briefly
    #[error(
        "a person is found in {count} of {searched} searched frames, at the same place; film one person from head to toe, \
         who turns on the spot"
    )]
    TooFew {
        /// Number of frames with the person at the usual place
        count: usize,
        /// Number of frames in which the person was searched
        searched: usize,
    },
}

/// Returns the standard deviation of a turn angle of a track by detected keypoints: see [`TurnTrack::without_detector_bias`]
///
/// 2 to 4.5 degrees over 14 rendered people of two families, least from the side. Elsewhere it counts less, since outlines
/// show the turn there, and neighboring frames have nearly the same error.
pub fn tracked_turn_sd_radians(turn: TurnAngle) -> f64 {
    const FROM_THE_SIDE_DEGREES: f64 = 2.5;
    const MORE_DEGREES: f64 = 3.5;
    (FROM_THE_SIDE_DEGREES + MORE_DEGREES * turn.radians().cos().abs()).to_radians()
}

/// Error of a track by keypoints of the pose networks: coefficients of the sines of the turn angle, its double and its
/// triple, in degrees
///
/// The networks place shoulders, hips and feet differently from the front, from the side and from behind; the same on both
/// sides. Means over networks and people of two families, between which they vary by 2, 1 and 1 degrees: see
/// `examples/detector_turns.rs` of pirouette-eval.
const DETECTOR_BIAS_DEGREES: [f64; 3] = [6.0, -3.0, 4.0];

/// Distances between keypoints of one frame that depend on the turn
#[derive(Debug, Clone, Copy)]
struct Seen {
    time_s: f64,
    /// Horizontal position of the trunk, in px
    x: f64,
    /// Height of the person, in px
    size: f64,
    /// Distances of left from right, and of toes from heels, in statures
    cosine: f64,
    sine: f64,
}

impl TurnTrack {
    /// Finds the turn angles by the keypoints of frames at increasing times, in s; `None` where no person is found
    ///
    /// Frames whose time does not increase are left out.
    ///
    /// # Errors
    /// When no person is found, or one is found in too few frames at one place.
    pub fn find<'a>(
        frames: impl Iterator<Item = (f64, Option<&'a Keypoints>)>,
    ) -> Result<Self, TrackError> {
        let mut searched = 0;
        let mut last_s = f64::NEG_INFINITY;
        let seen: Vec<Seen> = frames
            .filter_map(|(time_s, keypoints)| {
                searched += 1;
                if !(time_s.is_finite() && time_s > last_s) {
                    return None;
                }
                last_s = time_s;
                see(time_s, keypoints?)
            })
            .collect();
        if seen.is_empty() {
            return Err(TrackError::NoPerson);
        }
        let seen = at_usual_place(seen);
        if seen.len() < MIN_SAMPLES {
            let count = seen.len();
            return Err(TrackError::TooFew { count, searched });
        }
        let usual = [
            Extent::largest(&seen, |seen| seen.cosine, USUAL[0]),
            Extent::largest(&seen, |seen| seen.sine, USUAL[1]),
        ];
        let angle = |seen: &Seen, [across, forward]: [Extent; 2]| {
            forward.share(seen.sine).atan2(across.share(seen.cosine))
        };
        let first: Vec<f64> = seen.iter().map(|seen| angle(seen, usual)).collect();
        let extents = [
            Extent::of_turn(&seen, &first, |seen| seen.cosine).unwrap_or(usual[0]),
            Extent::of_turn(&seen, &first, |seen| seen.sine).unwrap_or(usual[1]),
        ];
        let raw: Vec<TurnSample> = continued(seen.iter().map(|seen| TurnSample {
            time_s: seen.time_s,
            angle_radians: angle(seen, extents),
        }));
        let samples = raw.iter().map(|sample| smoothed(&raw, *sample)).collect();
        Ok(Self { samples })
    }

    /// Removes the error of a track by keypoints of the pose networks, which depends on the turn angle only.
    pub fn without_detector_bias(mut self) -> Self {
        // The bias changes by less than half of the angle, so each pass halves the error.
        const PASSES: usize = 20;
        for sample in &mut self.samples {
            let found = sample.angle_radians;
            for _ in 0..PASSES {
                sample.angle_radians = found - detector_bias_radians(sample.angle_radians);
            }
        }
        self
    }

    /// Returns the angle at a time, in radians, by linear interpolation; `None` outside the track
    pub fn angle_at(&self, time_s: f64) -> Option<f64> {
        let after = self.samples.partition_point(|s| s.time_s < time_s);
        let b = self.samples.get(after)?;
        if b.time_s <= time_s {
            return Some(b.angle_radians);
        }
        let a = self.samples.get(after.checked_sub(1)?)?;
        let share = (time_s - a.time_s) / (b.time_s - a.time_s);
        Some(a.angle_radians + share * (b.angle_radians - a.angle_radians))
    }

    /// Returns the smallest and the largest angle, in radians
    pub fn range(&self) -> (f64, f64) {
        let angles = self.samples.iter().map(|sample| sample.angle_radians);
        angles.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), angle| {
            (low.min(angle), high.max(angle))
        })
    }
}

fn detector_bias_radians(angle: f64) -> f64 {
    let terms = DETECTOR_BIAS_DEGREES.iter().zip(1..);
    let sum: f64 = terms
        .map(|(size, k)| size * (f64::from(k) * angle).sin())
        .sum();
    sum.to_radians()
}

/// Middle and half of the range of a distance over the turn
#[derive(Debug, Clone, Copy)]
struct Extent {
    middle: f64,
    half: f64,
}

impl Extent {
    /// Returns the largest distance to either side, around 0
    fn largest(seen: &[Seen], of: fn(&Seen) -> f64, usual: f64) -> Self {
        let mut sizes: Vec<f64> = seen.iter().map(|seen| of(seen).abs()).collect();
        Self {
            middle: 0.0,
            half: quantile(&mut sizes, LARGEST).max(usual / 2.0),
        }
    }

    /// Returns the range of the mean distances in sectors of the approximate angles; `None` unless a complete turn is seen
    ///
    /// Detectors place joints differently from the front and from behind, so that the middle is not 0. Means of sectors
    /// do not depend on where the person stands still.
    fn of_turn(seen: &[Seen], angles: &[f64], of: fn(&Seen) -> f64) -> Option<Self> {
        const SECTORS: usize = 12;
        // The mean of a cosine over a sector around its extreme
        const OF_EXTREME: f64 = 0.989;
        let mut sums = [(0.0, 0.0); SECTORS];
        for (seen, angle) in seen.iter().zip(angles) {
            let sector = (angle / TAU * SECTORS as f64)
                .round()
                .rem_euclid(SECTORS as f64);
            let (sum, count) = &mut sums[sector as usize % SECTORS];
            *sum += of(seen);
            *count += 1.0;
        }
        let means: Option<Vec<f64>> = sums
            .iter()
            .map(|(sum, count)| (*count > 0.0).then(|| sum / count))
            .collect();
        let means = means?;
        let low = means.iter().copied().fold(f64::INFINITY, f64::min);
        let high = means.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let half = (high - low) / 2.0 / OF_EXTREME;
        (half > 0.0).then_some(Self {
            middle: (high + low) / 2.0,
            half,
        })
    }

    fn share(self, distance: f64) -> f64 {
        (distance - self.middle) / self.half
    }
}

/// Measures a frame; `None` without keypoints of trunk or feet
fn see(time_s: f64, keypoints: &Keypoints) -> Option<Seen> {
    let found = |joint: Joint| Some(keypoints.found(joint)?.position);
    let across = |left: Joint, right: Joint| Some(found(left)?.x - found(right)?.x);
    let shoulders = across(Joint::LeftShoulder, Joint::RightShoulder)?;
    let hips = across(Joint::LeftHip, Joint::RightHip)?;
    let feet = [
        (Joint::LeftBigToe, Joint::LeftHeel),
        (Joint::RightBigToe, Joint::RightHeel),
    ];
    let feet: Vec<f64> = feet
        .iter()
        .filter_map(|&(toe, heel)| across(toe, heel))
        .collect();
    if feet.is_empty() {
        return None;
    }
    let forward = feet.iter().sum::<f64>() / feet.len() as f64;
    let shoulder = (found(Joint::LeftShoulder)? + found(Joint::RightShoulder)?) / 2.0;
    let hip = (found(Joint::LeftHip)? + found(Joint::RightHip)?) / 2.0;
    // The trunk is 0.29 of the stature long.
    let size = (hip.y - shoulder.y).abs() / 0.29;
    (size > 1.0).then_some(Seen {
        time_s,
        x: (shoulder.x + hip.x) / 2.0,
        size,
        cosine: (shoulders + hips) / 2.0 / size,
        sine: forward / size,
    })
}

/// Keeps the frames in which the person is at the usual place, in the usual size
fn at_usual_place(seen: Vec<Seen>) -> Vec<Seen> {
    let middle = |of: fn(&Seen) -> f64| quantile(&mut seen.iter().map(of).collect::<Vec<_>>(), 0.5);
    let (x, size) = (middle(|seen| seen.x), middle(|seen| seen.size));
    seen.into_iter()
        .filter(|seen| {
            (seen.x - x).abs() < ELSEWHERE * size && (seen.size / size - 1.0).abs() < OTHER_SIZE
        })
        .collect()
}

/// Adds full turns so that successive angles are near each other
///
/// An angle is compared with the median of those shortly before it: a single wrong one must not add a turn.
fn continued(samples: impl Iterator<Item = TurnSample>) -> Vec<TurnSample> {
    const BEFORE: usize = 5;
    let mut all: Vec<TurnSample> = Vec::new();
    for mut sample in samples {
        let mut recent: Vec<f64> = all
            .iter()
            .rev()
            .take(BEFORE)
            .map(|s| s.angle_radians)
            .collect();
        if !recent.is_empty() {
            let near = quantile(&mut recent, 0.5);
            sample.angle_radians -= TAU * ((sample.angle_radians - near) / TAU).round();
        }
        all.push(sample);
    }
    all
}

/// Returns a sample on the line through its neighbors; those far from a first line are ignored
fn smoothed(samples: &[TurnSample], at: TurnSample) -> TurnSample {
    let start = samples.partition_point(|s| s.time_s < at.time_s - REACH_S);
    let end = samples.partition_point(|s| s.time_s <= at.time_s + REACH_S);
    let near = &samples[start..end];
    let mut angles: Vec<f64> = near.iter().map(|s| s.angle_radians).collect();
    let mut slopes: Vec<f64> = (0..near.len())
        .flat_map(|i| (0..i).map(move |j| (i, j)))
        .map(|(i, j)| {
            let rise = near[i].angle_radians - near[j].angle_radians;
            rise / (near[i].time_s - near[j].time_s)
        })
        .filter(|slope| slope.is_finite())
        .collect();
    // Theil and Sen: the median slope, and the median offset
    let slope = if slopes.is_empty() {
        0.0
    } else {
        quantile(&mut slopes, 0.5)
    };
    for (angle, sample) in angles.iter_mut().zip(near) {
        *angle -= slope * (sample.time_s - at.time_s);
    }
    let middle = quantile(&mut angles.clone(), 0.5);
    let kept = || {
        near.iter()
            .zip(&angles)
            .filter(|(_, angle)| (**angle - middle).abs() < OUTLIER_RADIANS)
    };
    let count = kept().count() as f64;
    let mean_s = kept().map(|(s, _)| s.time_s - at.time_s).sum::<f64>() / count;
    let mean = kept().map(|(s, _)| s.angle_radians).sum::<f64>() / count;
    let (mut up, mut across) = (0.0, 0.0);
    for (sample, _) in kept() {
        let along = sample.time_s - at.time_s - mean_s;
        up += along * (sample.angle_radians - mean);
        across += along * along;
    }
    let fitted = if across > 0.0 { up / across } else { 0.0 };
    TurnSample {
        time_s: at.time_s,
        angle_radians: mean - fitted * mean_s,
    }
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    let at = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// Returns the signed difference of two angles, from -pi to pi
pub(super) fn angle_between(a: f64, b: f64) -> f64 {
    (a - b + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use pirouette_body::Keypoint;

    /// Returns the keypoints of a person of 500 px who has turned by an angle, at a horizontal position
    fn turned(angle: f64, x: f64) -> Keypoints {
        let mut keypoints = Keypoints::default();
        let mut set = |joint, right: f64, forward: f64, y: f64| {
            let position = DVec2::new(x + right * angle.cos() + forward * angle.sin(), y);
            let confidence = 0.9;
            keypoints.set(
                joint,
                Keypoint {
                    position,
                    confidence,
                },
            );
        };
        set(Joint::LeftShoulder, 55.0, 0.0, 100.0);
        set(Joint::RightShoulder, -55.0, 0.0, 100.0);
        set(Joint::LeftHip, 35.0, 0.0, 245.0);
        set(Joint::RightHip, -35.0, 0.0, 245.0);
        set(Joint::LeftBigToe, 45.0, 50.0, 495.0);
        set(Joint::LeftHeel, 35.0, -10.0, 490.0);
        set(Joint::RightBigToe, -45.0, 50.0, 495.0);
        set(Joint::RightHeel, -35.0, -10.0, 490.0);
        keypoints
    }

    /// Returns the track of a person whose angle is a function of time, at ten frames a second
    fn track(seconds: f64, angle: impl Fn(f64) -> f64) -> TurnTrack {
        let times: Vec<f64> = (0..(seconds * 10.0) as usize)
            .map(|i| i as f64 / 10.0)
            .collect();
        let keypoints: Vec<Keypoints> = times.iter().map(|&t| turned(angle(t), 200.0)).collect();
        TurnTrack::find(times.iter().copied().zip(keypoints.iter().map(Some))).unwrap()
    }

    fn worst_degrees(track: &TurnTrack, angle: impl Fn(f64) -> f64) -> f64 {
        let errors = track
            .samples
            .iter()
            .map(|s| (s.angle_radians - angle(s.time_s)).abs());
        errors.fold(0.0, f64::max).to_degrees()
    }

    #[test]
    fn one_and_a_half_turns_in_either_direction_are_followed() {
        for direction in [1.0, -1.0] {
            let angle = |t: f64| direction * (0.3 + 1.5 * TAU * t / 20.0);
            let found = track(20.0, angle);
            assert!(worst_degrees(&found, angle) < 5.0, "{direction}");
            let (low, high) = found.range();
            assert!(((high - low).to_degrees() - 540.0).abs() < 10.0);
        }
    }

    #[test]
    fn a_detector_that_places_joints_to_one_side_changes_nothing_in_a_complete_turn() {
        let angle = |t: f64| TAU * t / 10.0;
        let times: Vec<f64> = (0..100).map(|i| i as f64 / 10.0).collect();
        let keypoints: Vec<Keypoints> = times
            .iter()
            .map(|&t| {
                let mut keypoints = turned(angle(t), 200.0);
                for joint in [Joint::LeftShoulder, Joint::LeftHip] {
                    let mut keypoint = keypoints.get(joint);
                    keypoint.position.x -= 15.0;
                    keypoints.set(joint, keypoint);
                }
                keypoints
            })
            .collect();
        let found = TurnTrack::find(times.iter().copied().zip(keypoints.iter().map(Some)));
        assert!(worst_degrees(&found.unwrap(), angle) < 5.0);
    }

    #[test]
    fn a_pause_is_followed() {
        let angle = |t: f64| (t.min(5.0) + (t - 8.0).max(0.0)) * TAU / 12.0;
        let found = track(15.0, angle);
        assert!(worst_degrees(&found, angle) < 8.0);
    }

    #[test]
    fn a_single_wrong_frame_changes_nothing() {
        let angle = |t: f64| TAU * t / 10.0;
        let found = track(10.0, |t| {
            if (t - 4.0).abs() < 0.01 {
                3.0 + angle(t)
            } else {
                angle(t)
            }
        });
        assert!(worst_degrees(&found, angle) < 6.0);
    }

    #[test]
    fn frames_before_the_person_has_arrived_are_left_out() {
        let times: Vec<f64> = (0..100).map(|i| i as f64 / 10.0).collect();
        let keypoints: Vec<Keypoints> = times
            .iter()
            .map(|&t| turned(t * TAU / 10.0, if t < 3.0 { 50.0 * t } else { 400.0 }))
            .collect();
        let found = TurnTrack::find(times.iter().copied().zip(keypoints.iter().map(Some))).unwrap();
        assert_eq!(found.samples[0].time_s, 3.0);
        assert_eq!(found.angle_at(2.0), None);
        assert!((found.angle_at(5.05).unwrap() - 5.05 * TAU / 10.0).abs() < 0.1);
    }

    #[test]
    fn frames_whose_time_goes_back_are_left_out() {
        let times: Vec<f64> = (0..100).map(|i| f64::from(i) / 10.0).collect();
        let keypoints: Vec<Keypoints> = times
            .iter()
            .map(|t| turned(t * TAU / 10.0, 200.0))
            .collect();
        let frame = |i: usize, time_s: f64| (time_s, Some(&keypoints[i]));
        let in_order = (0..100).map(|i| frame(i, times[i]));
        let expected = TurnTrack::find(in_order.clone()).unwrap();
        let damaged = in_order.flat_map(|(time_s, keypoints)| {
            [time_s, time_s - 3.0, f64::NAN].map(|time_s| (time_s, keypoints))
        });
        assert_eq!(TurnTrack::find(damaged).unwrap(), expected);
    }

    #[test]
    fn a_video_without_a_person_is_an_error() {
        let none = (0..50).map(|i| (i as f64 / 10.0, None));
        assert_eq!(TurnTrack::find(none), Err(TrackError::NoPerson));
        let one = turned(0.0, 10.0);
        let briefly = (0..50).map(|i| (i as f64 / 10.0, (i == 7).then_some(&one)));
        let error = TrackError::TooFew {
            count: 1,
            searched: 50,
        };
        assert_eq!(TurnTrack::find(briefly), Err(error));
    }

    #[test]
    fn the_bias_of_a_detector_is_removed_from_all_angles() {
        let sample = |i: i32| TurnSample {
            time_s: f64::from(i),
            angle_radians: f64::from(i) / 10.0,
        };
        let exact = TurnTrack {
            samples: (-90..90).map(sample).collect(),
        };
        let mut biased = exact.clone();
        for sample in &mut biased.samples {
            sample.angle_radians += detector_bias_radians(sample.angle_radians);
        }
        let found = biased.without_detector_bias();
        for (found, exact) in found.samples.iter().zip(&exact.samples) {
            assert!((found.angle_radians - exact.angle_radians).abs() < 1e-6);
        }
    }

    #[test]
    fn differences_of_angles_are_at_most_half_a_turn() {
        assert!((angle_between(0.1, TAU + 0.3) + 0.2).abs() < 1e-12);
        assert!((angle_between(-3.0, 3.0) - (TAU - 6.0)).abs() < 1e-12);
    }
}
