//! Tapes and landmarks of an avatar found from its shape, and the measures of an avatar whose surface is known.

use glam::DVec3;

use super::landmarks::{find_sections, with_lowered_arms};
use super::tape::Tape;
use super::{Girth, Landmark, Measure, lengths};
use pirouette_body::Avatar;

/// An avatar with its tapes and landmarks
pub(super) struct MarkedAvatar<'a> {
    avatar: &'a Avatar,
    /// The same avatar in A-pose, if it is in another pose
    lowered: Option<Avatar>,
    tapes: Vec<(Girth, Tape)>,
    /// Points of the surface with arms lowered
    landmarks: Vec<(Landmark, DVec3)>,
}

/// Tapes whose position differs when arms are stretched out level
pub(super) fn moves_with_arms(girth: Girth) -> bool {
    matches!(
        girth,
        Girth::Neck | Girth::Bust | Girth::Underbust | Girth::Overbust
    )
}

impl<'a> MarkedAvatar<'a> {
    pub(super) fn new(avatar: &'a Avatar) -> Self {
        let lowered = with_lowered_arms(avatar);
        let (mut sections, mut landmarks) = find_sections(avatar);
        if let Some(lowered) = &lowered {
            let (of_lowered, points) = find_sections(lowered);
            sections.retain(|s| !moves_with_arms(s.girth));
            sections.extend(of_lowered.into_iter().filter(|s| moves_with_arms(s.girth)));
            landmarks = points;
        }
        let tape = |section| Tape::of_section(section, avatar);
        Self {
            tapes: sections
                .iter()
                .filter_map(|s| Some((s.girth, tape(s)?)))
                .collect(),
            avatar,
            lowered,
            landmarks,
        }
    }

    /// Returns the avatar in A-pose, on which lengths are measured
    pub(super) fn in_a_pose(&self) -> &Avatar {
        self.lowered.as_ref().unwrap_or(self.avatar)
    }

    pub(super) fn tape(&self, girth: Girth) -> Option<&Tape> {
        let entry = self.tapes.iter().find(|(g, _)| *g == girth);
        entry.map(|(_, tape)| tape)
    }

    /// Returns all tapes as closed curves in space, world frame, mm
    pub(super) fn tape_curves(&self) -> Vec<(Girth, Vec<DVec3>)> {
        let curve = |(girth, tape): &(Girth, Tape)| (*girth, tape.points());
        self.tapes.iter().map(curve).collect()
    }

    pub(super) fn landmark(&self, landmark: Landmark) -> Option<DVec3> {
        let entry = self.landmarks.iter().find(|(l, _)| *l == landmark);
        entry.map(|(_, point)| *point)
    }
}

/// Measures an avatar along its own tapes and landmarks, in mm: the ground truth of a rendered person
///
/// Measures for which the avatar has no tape or landmark are omitted.
pub fn measure_avatar(avatar: &Avatar) -> Vec<(Measure, f64)> {
    let found = MarkedAvatar::new(avatar);
    let value = |measure: Measure| match measure {
        Measure::Stature => Some(avatar.stature_mm()),
        _ if measure.girths().is_empty() => {
            let sides = lengths::of_avatar(&found, measure)?;
            Some(sides.iter().sum::<f64>() / sides.len() as f64)
        }
        _ => {
            let girths: Option<Vec<f64>> = measure
                .girths()
                .iter()
                .map(|&girth| Some(found.tape(girth)?.girth()))
                .collect();
            let girths = girths?;
            Some(girths.iter().sum::<f64>() / girths.len() as f64)
        }
    };
    Measure::ALL
        .iter()
        .filter_map(|&measure| Some((measure, value(measure)?)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_body::mannequin::{MannequinParameters, mannequin};

    #[test]
    fn the_mannequin_has_every_measure_and_all_scale_with_its_stature() {
        let avatar = |stature_mm: f64| {
            mannequin(&MannequinParameters {
                stature_mm: Some(stature_mm),
                ..MannequinParameters::default()
            })
            .unwrap()
        };
        let small = measure_avatar(&avatar(1500.0));
        assert_eq!(small.len(), Measure::ALL.len());
        for ((measure, a), (_, b)) in small.iter().zip(measure_avatar(&avatar(1800.0))) {
            assert!(b > *a && b < 1.4 * a, "{measure:?} {a} {b}");
        }
    }
}
