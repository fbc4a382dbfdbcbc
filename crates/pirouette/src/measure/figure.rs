//! The measures of a figure whose surface is known.

use super::{Landmark, Measure, expected_tape, lengths};
use crate::avatar::Avatar;

/// Measures a figure along its own tape loops and landmarks, in mm: what is true about a rendered person
///
/// Measures for which the figure has no loop or landmark are left out.
pub fn measure_figure(figure: &Avatar) -> Vec<(Measure, f64)> {
    let height = |landmark| figure.landmark(landmark).map(|p| p.y);
    let level = |measure: Measure| {
        let girth = *measure.girths().first()?;
        Some(expected_tape(figure, girth)?.center().y)
    };
    let value = |measure: Measure| match measure {
        Measure::Stature => Some(figure.stature_mm()),
        Measure::ShoulderWidth => lengths::shoulder_width(figure).value_mm.ok(),
        Measure::ArmLength => lengths::arm_length(figure).value_mm.ok(),
        Measure::BackLength => lengths::back_length(figure).value_mm.ok(),
        Measure::CrotchHeight => height(Landmark::Crotch),
        Measure::BustHeight => level(Measure::BustGirth),
        Measure::WaistHeight => level(Measure::WaistGirth),
        Measure::HipHeight => level(Measure::HipGirth),
        _ => {
            let girths: Option<Vec<f64>> = measure
                .girths()
                .iter()
                .map(|&girth| Some(expected_tape(figure, girth)?.girth()))
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
