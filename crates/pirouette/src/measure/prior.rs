//! Survey statistics of people of a sex, stature and mass, where the person gave these.
//!
//! Regressions on ANSUR II ([`pirouette_body::survey`]) provide an additional estimate next to the one from pixels,
//! which is always reported, too. The survey is of adults: it is not used for children ([`holds_for`]).
//!
//! # Source
//! Gordon et al. 2014, *2012 Anthropometric Survey of U.S. Army Personnel: Methods and Summary Statistics*,
//! Natick/TR-15/007.

use super::{Estimate, Measure, MeasureInput, Measured, Method};
use pirouette_body::Sex;
use pirouette_body::survey::{Regression, holds_for};

/// Standard deviation due to differing tape positions and a sample of soldiers, as a share
const DEFINITION_SD: f64 = 0.02;

/// Ratio of the girth of a relaxed upper arm to that of a flexed one, which the survey measured
pub(super) const RELAXED_OVER_FLEXED: f64 = 0.945;

/// Returns the survey's dimension for a measure and the factor on it; the survey's waist is defined elsewhere
pub(super) fn dimension(measure: Measure) -> Option<(&'static str, f64)> {
    Some(match measure {
        Measure::NeckGirth => ("neck_girth", 1.0),
        Measure::BustGirth => ("chest_girth", 1.0),
        Measure::HipGirth => ("hip_girth", 1.0),
        Measure::ThighGirth => ("thigh_girth", 1.0),
        Measure::CalfGirth => ("calf_girth", 1.0),
        Measure::AnkleGirth => ("ankle_girth", 1.0),
        Measure::UpperArmGirth => ("biceps_flexed_girth", RELAXED_OVER_FLEXED),
        Measure::WristGirth => ("wrist_girth", 1.0),
        Measure::HeadGirth => ("head_girth", 1.0),
        Measure::FootLength => ("foot_length", 1.0),
        Measure::CrotchHeight => ("crotch_height", 1.0),
        _ => return None,
    })
}

/// Returns the expectation of the survey; `None` when it lacks the measure
pub(super) fn expect(
    measure: Measure,
    sex: Sex,
    stature_mm: f64,
    mass_kg: f64,
) -> Option<Estimate> {
    let (dimension, factor) = dimension(measure)?;
    let regression = Regression::of(dimension, sex)?;
    let value_mm = factor * regression.mean_mm(stature_mm, mass_kg);
    Some(Estimate {
        value_mm,
        sd_mm: (factor * regression.sd_mm).hypot(DEFINITION_SD * value_mm),
    })
}

/// Combines a measured value with the survey, where the person gave sex, stature and mass
pub(super) fn support(input: &MeasureInput, measure: Measure, measured: Measured) -> Measured {
    let subject = input.subject;
    let (Some(sex), Some(mass_kg), Some(stature_mm)) =
        (subject.sex, subject.mass_kg, input.barefoot_mm())
    else {
        return measured;
    };
    if !holds_for(stature_mm, subject.age_years) {
        return measured;
    }
    let (Some(prior), Ok(value_mm), Some(sd_mm)) = (
        expect(measure, sex, stature_mm, mass_kg),
        measured.value_mm,
        measured.sd_mm,
    ) else {
        return measured;
    };
    let pixels = Estimate { value_mm, sd_mm };
    let (a, b) = (prior.sd_mm.powi(2), sd_mm.powi(2));
    Measured {
        value_mm: Ok((a * value_mm + b * prior.value_mm) / (a + b)),
        sd_mm: Some((a * b / (a + b)).sqrt()),
        method: Method::WithStatistics,
        pixels: Some(pixels),
        prior: Some(prior),
        ..measured
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_of_the_survey_are_reproduced() {
        // Mean man: neck 398 mm, calf 392 mm
        for (measure, mean) in [(Measure::NeckGirth, 398.0), (Measure::CalfGirth, 392.0)] {
            let found = expect(measure, Sex::Male, 1756.2, 85.5).unwrap();
            assert!((found.value_mm - mean).abs() < 5.0, "{found:?}");
            assert!((8.0..30.0).contains(&found.sd_mm), "{found:?}");
        }
        assert_eq!(expect(Measure::WaistGirth, Sex::Male, 1756.2, 85.5), None);
        assert_eq!(expect(Measure::NeckGirth, Sex::Neutral, 1756.2, 85.5), None);
    }
}
