//! The published results and our goals, in one table.

use serde_json::{Value, json};

/// A result that is compared with a published one
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the goals document the variants")]
pub enum Figure {
    SegmentationMedian,
    SegmentationPassed,
    PhotosMedian,
    PhotosPassed,
    DeformationMean,
    DeformationWorst,
    RegistrationMean,
    RegistrationWorst,
    RegistrationOtherSex,
    RegistrationOtherBuild,
    RegistrationTime,
    RegistrationOptimum,
    RefinementUpper,
    RefinementLower,
}

/// The bound of a figure
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Limit {
    /// At most this value
    AtMost(f64),
    /// At least this value
    AtLeast(f64),
}

/// The goal of one figure
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// The figure
    pub figure: Figure,
    /// Its name, with the source in the paper
    pub name: &'static str,
    /// Its unit, appended to the number
    pub unit: &'static str,
    /// Number of decimals to print
    pub decimals: usize,
    /// The published value
    pub published: &'static str,
    /// The bound for our value
    pub limit: Limit,
}

/// All goals, in the order of the page
pub const GOALS: [Goal; 14] = {
    use Figure::*;
    use Limit::{AtLeast, AtMost};
    const fn goal(
        figure: Figure,
        name: &'static str,
        (unit, decimals): (&'static str, usize),
        published: &'static str,
        limit: Limit,
    ) -> Goal {
        Goal {
            figure,
            name,
            unit,
            decimals,
            published,
            limit,
        }
    }
    [
        goal(
            SegmentationMedian,
            "Segmentation of rendered scans, median Jaccard index",
            ("", 4),
            "0.926 (photos)",
            AtLeast(0.975),
        ),
        goal(
            SegmentationPassed,
            "Segmentation of rendered scans, photos that pass",
            (" %", 1),
            "96.3 % (962 of 999)",
            AtLeast(100.0),
        ),
        goal(
            PhotosMedian,
            "Segmentation of given photos, median Jaccard index",
            ("", 4),
            "0.926",
            AtLeast(0.94),
        ),
        goal(
            PhotosPassed,
            "Segmentation of given photos, photos that pass",
            (" %", 1),
            "96.3 % (962 of 999)",
            AtLeast(100.0),
        ),
        goal(
            DeformationMean,
            "Table 1: arm joints moved and back, mean Dice index",
            (" %", 2),
            "96.1 to 97.3 %, with 2 px allowed",
            AtLeast(99.5),
        ),
        goal(
            DeformationWorst,
            "Table 1: arm joints moved and back, worst Dice index",
            (" %", 2),
            "96.1 to 97.3 %, with 2 px allowed",
            AtLeast(99.0),
        ),
        goal(
            RegistrationMean,
            "Table 2: registration, mean error",
            (" px", 3),
            "2.96 px",
            AtMost(0.5),
        ),
        goal(
            RegistrationWorst,
            "Table 2: registration, worst error",
            (" px", 3),
            "6.47 px",
            AtMost(1.5),
        ),
        goal(
            RegistrationOtherSex,
            "Table 2: registration to a reference of the other sex, mean error",
            (" px", 2),
            "4.5 px",
            AtMost(2.5),
        ),
        goal(
            RegistrationOtherBuild,
            "Table 2: registration to a reference of another build, mean error",
            (" px", 2),
            "12.5 px",
            AtMost(2.5),
        ),
        goal(
            RegistrationTime,
            "Time of one registration, one thread, median",
            (" ms", 2),
            "1153 ms",
            AtMost(5.0),
        ),
        goal(
            RegistrationOptimum,
            "Registrations whose optimum is no worse than that of the published search",
            (" %", 1),
            "(the search itself)",
            AtLeast(100.0),
        ),
        goal(
            RefinementUpper,
            "Table 3: angle of the upper arm, mean deviation",
            ("°", 4),
            "0.034°",
            AtMost(0.02),
        ),
        goal(
            RefinementLower,
            "Table 3: angle of the forearm, mean deviation",
            ("°", 4),
            "0.074°",
            AtMost(0.02),
        ),
    ]
};

impl Goal {
    /// Returns whether a value reaches the goal; false for NaN
    pub fn reached(&self, value: f64) -> bool {
        match self.limit {
            Limit::AtMost(limit) => value <= limit,
            Limit::AtLeast(limit) => value >= limit,
        }
    }

    /// Formats a value with its unit
    pub fn show(&self, value: f64) -> String {
        format!("{value:.*}{}", self.decimals, self.unit)
    }

    /// Formats the bound
    pub fn show_limit(&self) -> String {
        match self.limit {
            Limit::AtMost(limit) => format!("at most {limit}{}", self.unit),
            Limit::AtLeast(limit) => format!("at least {limit}{}", self.unit),
        }
    }

    /// Returns the goal and a value as JSON
    pub fn to_json(&self, value: f64) -> Value {
        let (at_most, at_least) = match self.limit {
            Limit::AtMost(limit) => (Some(limit), None),
            Limit::AtLeast(limit) => (None, Some(limit)),
        };
        json!({
            "name": self.name,
            "value": (value * 1e5).round() / 1e5,
            "unit": self.unit.trim(),
            "published": self.published,
            "at_most": at_most,
            "at_least": at_least,
            "reached": self.reached(value),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_figure_has_one_goal() {
        for goal in &GOALS {
            let same = GOALS.iter().filter(|g| g.figure == goal.figure);
            assert_eq!(same.count(), 1, "{}", goal.name);
        }
    }

    #[test]
    fn nan_reaches_no_goal() {
        for goal in &GOALS {
            assert!(!goal.reached(f64::NAN));
            let (Limit::AtMost(limit) | Limit::AtLeast(limit)) = goal.limit;
            assert!(goal.reached(limit));
            let beyond = match goal.limit {
                Limit::AtMost(limit) => limit + 0.01,
                Limit::AtLeast(limit) => limit - 0.01,
            };
            assert!(!goal.reached(beyond), "{}", goal.name);
        }
    }
}
