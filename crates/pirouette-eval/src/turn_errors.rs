//! Errors of turn angles.

use pirouette_body::TurnAngle;

use crate::table::{Cell, mean};

/// Angles of one scan with their errors, in degrees; the mean error is subtracted
#[derive(Debug, Clone, Default)]
pub(crate) struct TurnErrors {
    pub(crate) degrees: Vec<f64>,
    /// Error relative to the reported standard deviation
    pub(crate) relative: Vec<f64>,
    /// Error of each turn from one photo to the next, per 10 degrees
    pub(crate) per_ten: Vec<f64>,
    /// Mean error
    pub(crate) offset_degrees: f64,
}

impl TurnErrors {
    /// Compares found angles with true ones
    pub(crate) fn new(found: &[(TurnAngle, Option<f64>)], truth: &[TurnAngle]) -> Self {
        let apart = |a: f64, b: f64| (a - b + 180.0).rem_euclid(360.0) - 180.0;
        let pairs: Vec<(f64, f64)> = found
            .iter()
            .zip(truth)
            .map(|((found, _), truth)| (found.degrees(), truth.degrees()))
            .collect();
        let (sine, cosine) = pairs
            .iter()
            .fold((0.0, 0.0), |(sine, cosine), (found, truth)| {
                let off = (found - truth).to_radians();
                (sine + off.sin(), cosine + off.cos())
            });
        let offset_degrees = f64::atan2(sine, cosine).to_degrees();
        let degrees: Vec<f64> = pairs
            .iter()
            .map(|(found, truth)| apart(found - offset_degrees, *truth))
            .collect();
        let relative = degrees.iter().zip(found);
        let relative = relative.filter_map(|(error, (_, sd))| Some(error / (*sd)?.to_degrees()));
        let mut around: Vec<(f64, f64)> = truth
            .iter()
            .zip(&degrees)
            .map(|(truth, error)| (truth.wrapped().degrees(), *error))
            .collect();
        around.sort_by(|a, b| a.0.total_cmp(&b.0));
        let next = around.iter().cycle().skip(1);
        let per_ten = around
            .iter()
            .zip(next)
            .map(|(from, to)| 10.0 * (to.1 - from.1).abs() / (to.0 - from.0).rem_euclid(360.0));
        Self {
            relative: relative.collect(),
            per_ten: per_ten.filter(|error| error.is_finite()).collect(),
            degrees,
            offset_degrees,
        }
    }

    /// Returns mean and worst error, error / SD, mean and worst error per 10 degrees, of several scans
    pub(crate) fn cells(all: &[&TurnErrors]) -> Vec<Cell> {
        let join = |of: &dyn Fn(&TurnErrors) -> &Vec<f64>| -> Vec<f64> {
            all.iter()
                .flat_map(|errors| of(errors).iter().copied())
                .collect()
        };
        let (degrees, per_ten) = (join(&|e| &e.degrees), join(&|e| &e.per_ten));
        let squares: Vec<f64> = join(&|e| &e.relative).iter().map(|z| z * z).collect();
        vec![
            Cell::number(mean_size(&degrees), 2),
            Cell::number(worst(&degrees), 1),
            Cell::number(mean(&squares).map(f64::sqrt), 2),
            Cell::number(mean(&per_ten), 2),
            Cell::number(worst(&per_ten), 2),
        ]
    }
}

/// Returns the mean of absolute values
pub(crate) fn mean_size(values: &[f64]) -> Option<f64> {
    mean(&values.iter().map(|value| value.abs()).collect::<Vec<_>>())
}

/// Returns the largest absolute value
pub(crate) fn worst(values: &[f64]) -> Option<f64> {
    values.iter().map(|v| v.abs()).max_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn degrees(all: &[f64]) -> Vec<TurnAngle> {
        all.iter().map(|&d| TurnAngle::from_degrees(d)).collect()
    }

    #[test]
    fn a_common_offset_is_no_error() {
        let truth = degrees(&[0.0, 90.0, 270.0]);
        let found: Vec<(TurnAngle, Option<f64>)> = degrees(&[350.0, 80.0, 260.0])
            .into_iter()
            .map(|turn| (turn, None))
            .collect();
        let errors = TurnErrors::new(&found, &truth);
        assert!(errors.degrees.iter().all(|error| error.abs() < 1e-9));
        assert!((errors.offset_degrees + 10.0).abs() < 1e-9);
    }

    #[test]
    fn errors_are_relative_to_the_turn_between_photos() {
        let truth = degrees(&[0.0, 20.0, 180.0]);
        let sd = Some(2.0_f64.to_radians());
        let found: Vec<(TurnAngle, Option<f64>)> = degrees(&[2.0, 18.0, 180.0])
            .into_iter()
            .map(|turn| (turn, sd))
            .collect();
        let errors = TurnErrors::new(&found, &truth);
        assert!((errors.degrees[0] - 2.0).abs() < 1e-9);
        assert!((errors.relative[1] + 1.0).abs() < 1e-9);
        assert!((errors.per_ten[0] - 2.0).abs() < 1e-9);
    }
}
