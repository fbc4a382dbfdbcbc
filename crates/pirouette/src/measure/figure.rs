//! Tapes and landmarks of a figure by the shape that it has, and the measures of a figure whose surface is known.

use glam::DVec3;

use super::lengths;
use super::tape::Tape;
use super::{Girth, Landmark, Measure};
use crate::avatar::Avatar;
use crate::avatar::landmarks::find_sections;

/// A figure with its tapes and landmarks
pub(super) struct Figure<'a> {
    pub(super) avatar: &'a Avatar,
    tapes: Vec<(Girth, Tape)>,
    landmarks: Vec<(Landmark, u32)>,
}

impl<'a> Figure<'a> {
    pub(super) fn new(avatar: &'a Avatar) -> Self {
        let (sections, landmarks) = find_sections(avatar);
        let tape = |section| Tape::of_section(section, avatar);
        Self {
            avatar,
            tapes: sections
                .iter()
                .filter_map(|s| Some((s.girth, tape(s)?)))
                .collect(),
            landmarks,
        }
    }

    pub(super) fn tape(&self, girth: Girth) -> Option<&Tape> {
        let entry = self.tapes.iter().find(|(g, _)| *g == girth);
        entry.map(|(_, tape)| tape)
    }

    /// All tapes as closed curves in space, world frame, mm
    pub(super) fn tape_curves(&self) -> Vec<(Girth, Vec<DVec3>)> {
        let curve = |(girth, tape): &(Girth, Tape)| (*girth, tape.points());
        self.tapes.iter().map(curve).collect()
    }

    pub(super) fn landmark(&self, landmark: Landmark) -> Option<DVec3> {
        let (_, vertex) = self.landmarks.iter().find(|(l, _)| *l == landmark)?;
        self.avatar.mesh.positions.get(*vertex as usize).copied()
    }
}

/// Measures a figure along its own tapes and landmarks, in mm: what is true about a rendered person
///
/// Measures for which the figure has no place are left out.
pub fn measure_figure(figure: &Avatar) -> Vec<(Measure, f64)> {
    let found = Figure::new(figure);
    let value = |measure: Measure| match measure {
        Measure::Stature => Some(figure.stature_mm()),
        _ if measure.girths().is_empty() => {
            let sides = lengths::of_figure(&found, measure)?;
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
    use crate::avatar::mannequin::{MannequinParameters, mannequin};

    #[test]
    fn the_mannequin_has_every_measure_and_all_grow_with_its_stature() {
        let figure = |stature_mm: f64| {
            mannequin(&MannequinParameters {
                stature_mm: Some(stature_mm),
                ..MannequinParameters::default()
            })
            .unwrap()
        };
        let small = measure_figure(&figure(1500.0));
        assert_eq!(small.len(), Measure::ALL.len());
        for ((measure, a), (_, b)) in small.iter().zip(measure_figure(&figure(1800.0))) {
            assert!(b > *a && b < 1.4 * a, "{measure:?} {a} {b}");
        }
    }
}
