//! What became of a capture: its outcome, and the errors of its measures.

use pirouette::measure::Measure;
use pirouette_files::job::{FinishedJob, JobError};

/// Measures that decide whether a result is right
pub(super) const MEASURES: [Measure; 7] = [
    Measure::NeckGirth,
    Measure::BustGirth,
    Measure::WaistGirth,
    Measure::HipGirth,
    Measure::ThighGirth,
    Measure::CalfGirth,
    Measure::CrotchHeight,
];

/// Largest error of a right measure, in its reported standard deviations
pub(super) const MAX_DEVIATIONS: f64 = 3.0;

/// Errors below this are right whatever the standard deviation, in mm
pub(super) const MIN_ERROR_MM: f64 = 10.0;

/// Codes of the warnings that state a correction of the input
const CORRECTIONS: [&str; 10] = [
    "lens_distorted",
    "other_pose",
    "mask_fixed",
    "camera_contradicted",
    "beside_middle",
    "turned_backward",
    "turns_halved",
    "turns_shifted",
    "sides_swapped",
    "view_dropped",
];

/// Code of a view that was excluded when the capture was loaded
const VIEW_EXCLUDED: &str = "view_excluded";

/// What became of a capture
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// No measurements, and the reason
    Refused,
    /// All measures are right, and a warning states that the input was corrected
    Corrected,
    /// All measures are right, without a correction
    Right,
    /// A measure is wrong by more than its standard deviation allows
    Wrong,
}

impl Outcome {
    pub(super) const ALL: [Outcome; 4] = [
        Outcome::Refused,
        Outcome::Corrected,
        Outcome::Right,
        Outcome::Wrong,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Outcome::Refused => "refused",
            Outcome::Corrected => "corrected",
            Outcome::Right => "right",
            Outcome::Wrong => "wrong",
        }
    }
}

/// One measure of a capture
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    pub(super) measure: Measure,
    pub(super) true_mm: f64,
    pub(super) value_mm: f64,
    /// Standard deviation reported with the value, if any
    pub(super) sd_mm: Option<f64>,
}

impl Measured {
    pub(super) fn error_mm(&self) -> f64 {
        self.value_mm - self.true_mm
    }

    /// Returns whether the error is at most a number of standard deviations
    pub(super) fn within(&self, deviations: f64) -> bool {
        let sd_mm = self.sd_mm.unwrap_or(0.0);
        self.error_mm().abs() <= deviations * sd_mm
    }

    pub(super) fn is_right(&self) -> bool {
        self.within(MAX_DEVIATIONS) || self.error_mm().abs() <= MIN_ERROR_MM
    }
}

/// The result of a capture
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Judged {
    pub(super) outcome: Outcome,
    /// Why there are no measurements
    pub(super) reason: Option<String>,
    /// Codes of all warnings, each once, sorted
    pub(super) warnings: Vec<String>,
    /// Mean overlap of the body with the silhouettes
    pub(super) overlap: Option<f64>,
    /// The available ones of [`MEASURES`]
    pub(super) measured: Vec<Measured>,
}

impl Judged {
    /// Lists the wrong measures with their errors and standard deviations, in mm
    pub(super) fn wrong_measures(&self) -> String {
        let wrong = self.measured.iter().filter(|m| !m.is_right());
        let listed: Vec<String> = wrong
            .map(|m| {
                let sd = m.sd_mm.map_or("-".to_owned(), |sd| format!("{sd:.0}"));
                format!("{} {:+.0} ± {sd}", name_of(m.measure), m.error_mm())
            })
            .collect();
        listed.join(", ")
    }
}

/// Returns the name of a measure in tables
pub(super) fn name_of(measure: Measure) -> String {
    measure.name().replace('_', " ")
}

/// Judges the result of a job by the true measures
pub(super) fn judge(done: &Result<FinishedJob, JobError>, truth: &[(Measure, f64)]) -> Judged {
    let done = match done {
        Ok(done) => done,
        Err(error) => return refused(error.to_string()),
    };
    let report = &done.report;
    let mut warnings: Vec<&'static str> = done.loaded.warnings.iter().map(|w| w.code()).collect();
    warnings.extend(report.warnings.iter().map(|w| w.code()));
    if !done.loaded.failed.is_empty() {
        warnings.push(VIEW_EXCLUDED);
    }
    warnings.sort_unstable();
    warnings.dedup();
    let measured: Vec<Measured> = MEASURES
        .iter()
        .filter_map(|&measure| {
            let found = report.measurements.as_ref()?.get(measure);
            let (_, true_mm) = truth.iter().find(|(m, _)| *m == measure)?;
            Some(Measured {
                measure,
                true_mm: *true_mm,
                value_mm: found.value_mm.ok()?,
                sd_mm: found.sd_mm,
            })
        })
        .collect();
    let reason = match (&report.refusal, measured.is_empty()) {
        (Some(refusal), _) => Some(refusal.code().to_owned()),
        (None, true) => Some("no measurements".to_owned()),
        (None, false) => None,
    };
    Judged {
        outcome: outcome(reason.is_some(), &warnings, &measured),
        reason,
        warnings: warnings.into_iter().map(str::to_owned).collect(),
        overlap: report.mean_fit_iou(),
        measured,
    }
}

/// Returns the result of a capture without measurements
pub(super) fn refused(reason: String) -> Judged {
    Judged {
        outcome: Outcome::Refused,
        reason: Some(reason),
        warnings: Vec::new(),
        overlap: None,
        measured: Vec::new(),
    }
}

fn outcome(refused: bool, warnings: &[&str], measured: &[Measured]) -> Outcome {
    let corrects = |code: &&str| CORRECTIONS.contains(code) || *code == VIEW_EXCLUDED;
    if refused {
        Outcome::Refused
    } else if !measured.iter().all(Measured::is_right) {
        Outcome::Wrong
    } else if warnings.iter().any(corrects) {
        Outcome::Corrected
    } else {
        Outcome::Right
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn waist(value_mm: f64, sd_mm: Option<f64>) -> Measured {
        Measured {
            measure: Measure::WaistGirth,
            true_mm: 800.0,
            value_mm,
            sd_mm,
        }
    }

    #[test]
    fn errors_beyond_three_deviations_and_10_mm_are_wrong() {
        assert!(waist(809.0, Some(1.0)).is_right());
        assert!(waist(770.0, Some(10.0)).is_right());
        assert!(!waist(769.0, Some(10.0)).is_right());
        assert!(!waist(811.0, Some(3.0)).is_right());
        assert!(waist(810.0, None).is_right() && !waist(811.0, None).is_right());
    }

    #[test]
    fn an_error_of_two_deviations_is_within_two_and_three() {
        let within = [1.0, 2.0, 3.0].map(|deviations| waist(810.0, Some(5.0)).within(deviations));
        assert_eq!(within, [false, true, true]);
        assert!(waist(800.0, None).within(1.0));
    }

    #[test]
    fn one_wrong_measure_makes_a_capture_wrong_despite_a_correction() {
        let (right, wrong) = (waist(802.0, Some(4.0)), waist(830.0, Some(4.0)));
        let all = |refused, warnings: &[&str], measured: &[Measured]| {
            outcome(refused, warnings, measured).name()
        };
        assert_eq!(all(false, &[], &[right]), "right");
        assert_eq!(all(false, &["low_overlap"], &[right]), "right");
        assert_eq!(all(false, &["sides_swapped"], &[right]), "corrected");
        assert_eq!(all(false, &["view_excluded"], &[right]), "corrected");
        assert_eq!(all(false, &["sides_swapped"], &[right, wrong]), "wrong");
        assert_eq!(all(true, &[], &[wrong]), "refused");
    }
}
