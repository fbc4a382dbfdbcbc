//! The scene without the person: from frames in which the person is not yet, or no longer, at the turning axis.

use pirouette_geom::Mask;
use pirouette_geom::parallel::prelude::*;
use pirouette_pose::PoseModel;

use super::Survey;
use crate::detect::{detect_in, to_keypoints};
use crate::scan::{Background, Photo};
use pirouette_body::{Joint, Keypoints};

/// Number of frames that are used
const FRAMES: usize = 5;

/// Distance of the person from the usual place from which on what is behind it is seen, in statures
const ASIDE: f64 = 0.35;

/// Distance from the joints that may be hidden by the person, in statures
const REACH: f64 = 0.12;

/// Time without a person, before or after, from which on frames are used, in s
const ABSENT_S: f64 = 0.3;

/// Returns the numbers of frames in which the person seems to be aside or absent, in order
///
/// A person who is not found between frames with the person is only overlooked.
pub(super) fn frames_without(survey: &Survey) -> Vec<usize> {
    let searched: Vec<_> = survey
        .frames
        .iter()
        .filter(|frame| frame.searched)
        .collect();
    let seen = |keypoints: &Keypoints| place(keypoints);
    let mut places: Vec<(f64, f64)> = searched
        .iter()
        .filter_map(|frame| seen(frame.keypoints.as_ref()?))
        .collect();
    if places.is_empty() {
        return Vec::new();
    }
    let middle = places.len() / 2;
    let x = places
        .select_nth_unstable_by(middle, |a, b| a.0.total_cmp(&b.0))
        .1
        .0;
    let size = places
        .select_nth_unstable_by(middle, |a, b| a.1.total_cmp(&b.1))
        .1
        .1;
    let found = |i: &usize| searched[*i].keypoints.is_some();
    let first_s = (0..searched.len()).find(found).map(|i| searched[i].time_s);
    let last_s = (0..searched.len()).rfind(found).map(|i| searched[i].time_s);
    let without = searched.iter().filter(|frame| match &frame.keypoints {
        Some(keypoints) => place(keypoints).is_some_and(|(at, _)| (at - x).abs() > ASIDE * size),
        None => {
            first_s.is_some_and(|first_s| frame.time_s < first_s - ABSENT_S)
                || last_s.is_some_and(|last_s| frame.time_s > last_s + ABSENT_S)
        }
    });
    let without: Vec<usize> = without.map(|frame| frame.index).collect();
    // Spread over all of them
    let count = without.len().min(FRAMES);
    (0..count)
        .map(|i| without[i * without.len() / count])
        .collect()
}

/// Returns the horizontal position of the trunk, and the height of the person by it, in px
fn place(keypoints: &Keypoints) -> Option<(f64, f64)> {
    let found = |joint: Joint| Some(keypoints.found(joint)?.position);
    let shoulders = found(Joint::LeftShoulder)?.midpoint(found(Joint::RightShoulder)?);
    let hips = found(Joint::LeftHip)?.midpoint(found(Joint::RightHip)?);
    // The trunk is 0.29 of the stature long.
    Some((
        (shoulders.x + hips.x) / 2.0,
        (hips.y - shoulders.y).abs() / 0.29,
    ))
}

/// Combines the scene that several frames show beside the person, who is searched in each; `None` without frames
///
/// Where several frames show it, the color is the median.
pub(super) fn combine(frames: &[Photo], model: &PoseModel) -> Option<Background> {
    let first = frames.first()?;
    let (width, height) = (first.width(), first.height());
    let known: Vec<Vec<bool>> = frames
        .par_iter()
        .filter(|frame| frame.same_size(first))
        .map(|frame| {
            let person = detect_in(model, frame, None, true, false);
            let person = person.map(|found| to_keypoints(&found.landmarks));
            columns_beside(person.as_ref(), width)
        })
        .collect();
    let mut photo = Photo::filled(width, height, [0; 3]);
    let rows = photo.as_mut_slice().par_chunks_mut(width).enumerate();
    rows.for_each(|(y, row)| {
        let mut levels = Vec::with_capacity(frames.len());
        for (x, color) in row.iter_mut().enumerate() {
            *color = std::array::from_fn(|channel| {
                levels.clear();
                let seen = frames.iter().zip(&known).filter(|(_, known)| known[x]);
                levels.extend(seen.map(|(frame, _)| frame[(x, y)][channel]));
                levels.sort_unstable();
                levels.get(levels.len() / 2).copied().unwrap_or(0)
            });
        }
    });
    let any = |x: usize| known.iter().any(|known| known[x]);
    let background = Background {
        photo,
        known: Mask::from_fn(width, height, |x, _| any(x)),
    };
    (0..width).any(any).then_some(background)
}

/// Returns which columns of a photo a person does not hide: shadows reach up and down, but hardly to the sides
fn columns_beside(person: Option<&Keypoints>, width: usize) -> Vec<bool> {
    let Some(person) = person else {
        return vec![true; width];
    };
    let found = || {
        let joints = Joint::ALL.into_iter();
        joints.filter_map(|joint| Some(person.found(joint)?.position))
    };
    let range = |of: fn(glam::DVec2) -> f64| {
        found()
            .map(of)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
                (low.min(v), high.max(v))
            })
    };
    let (left, right) = range(|p| p.x);
    let (top, bottom) = range(|p| p.y);
    let reach = REACH * (bottom - top).max(right - left);
    let hidden = left - reach..=right + reach;
    (0..width)
        .map(|x| !hidden.contains(&(x as f64 + 0.5)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::FrameFacts;
    use super::*;
    use glam::DVec2;
    use pirouette_body::Keypoint;

    /// Returns the keypoints of a person of 400 px
    fn person(x: f64) -> Keypoints {
        let mut keypoints = Keypoints::default();
        for (joint, dx, y) in [
            (Joint::LeftShoulder, 40.0, 100.0),
            (Joint::RightShoulder, -40.0, 100.0),
            (Joint::LeftHip, 30.0, 216.0),
            (Joint::RightHip, -30.0, 216.0),
            (Joint::LeftHeel, 30.0, 420.0),
        ] {
            let position = DVec2::new(x + dx, y);
            keypoints.set(
                joint,
                Keypoint {
                    position,
                    confidence: 0.9,
                },
            );
        }
        keypoints
    }

    fn survey(places: &[Option<f64>]) -> Survey {
        let frames = places.iter().enumerate().map(|(index, x)| FrameFacts {
            index: 3 * index,
            time_s: index as f64 / 10.0,
            sharpness: 100.0,
            brightness: 100.0,
            searched: true,
            keypoints: x.map(person),
        });
        Survey {
            frames: frames.collect(),
            size_px: (540, 960),
            two_people: None,
        }
    }

    #[test]
    fn frames_before_the_person_comes_and_with_the_person_aside_show_the_scene() {
        let mut places = vec![None; 6];
        places.extend([Some(20.0), Some(100.0), Some(200.0)]);
        places.extend([Some(270.0); 20]);
        places.extend([None; 3]);
        places.extend([Some(270.0); 20]);
        // 0.3 s before the person is found, somebody may already be half in the picture.
        assert_eq!(frames_without(&survey(&places)), [0, 3, 6, 18, 21]);
    }

    #[test]
    fn a_person_who_is_always_at_the_axis_or_never_seen_leaves_nothing() {
        assert_eq!(frames_without(&survey(&[Some(270.0); 30])), [0; 0]);
        assert_eq!(frames_without(&survey(&[None; 30])), [0; 0]);
        assert_eq!(frames_without(&Survey::default()), [0; 0]);
    }

    #[test]
    fn the_columns_of_a_person_are_hidden() {
        let beside = columns_beside(Some(&person(150.0)), 400);
        let hidden: Vec<usize> = (0..400).filter(|&x| !beside[x]).collect();
        // The joints are 320 px high, and 80 px wide.
        assert_eq!((hidden[0], hidden[hidden.len() - 1]), (72, 227));
        assert!(columns_beside(None, 400).iter().all(|known| *known));
    }
}
