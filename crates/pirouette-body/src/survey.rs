//! Body dimensions by sex, stature and mass: regressions on the ANSUR II survey.
//!
//! # Source
//! Gordon et al. 2014, *2012 Anthropometric Survey of U.S. Army Personnel: Methods and Summary Statistics*,
//! Natick/TR-15/007. `assets/README.md` of this crate describes how the regressions were fitted.

use std::sync::LazyLock;

use crate::Sex;

const TABLE: &str = include_str!("../assets/ansur2_regressions.csv");

static REGRESSIONS: LazyLock<Vec<Regression>> =
    LazyLock::new(|| TABLE.lines().skip(1).map(parse_row).collect());

/// One dimension of one sex as a linear function of the stature and of the square root of mass over stature
#[derive(Debug, Clone, PartialEq)]
pub struct Regression {
    dimension: &'static str,
    sex: &'static str,
    /// Of 1, the stature in m, and the root of mass in kg over stature in m; mm
    coefficients: [f64; 3],
    /// Standard deviation of people around the regression, in mm
    pub sd_mm: f64,
}

impl Regression {
    /// Returns the regression of a dimension by its name in the table; `None` for an unknown dimension and for
    /// [`Sex::Neutral`]
    ///
    /// # Panics
    /// Never: the table is part of the program, and its numbers parse.
    pub fn of(dimension: &str, sex: Sex) -> Option<&'static Self> {
        let mut rows = REGRESSIONS.iter();
        rows.find(|row| row.dimension == dimension && row.sex == sex.name())
    }

    /// Returns the mean of people of a given stature and mass, in mm
    pub fn mean_mm(&self, stature_mm: f64, mass_kg: f64) -> f64 {
        let stature_m = stature_mm / 1000.0;
        let [constant, by_stature, by_build] = self.coefficients;
        constant + by_stature * stature_m + by_build * (mass_kg / stature_m).sqrt()
    }
}

fn parse_row(row: &'static str) -> Regression {
    let cells: Vec<&str> = row.split(',').collect();
    let number = |column: usize| -> f64 {
        let parsed = cells[column].parse();
        parsed.expect("the table has a number in this column")
    };
    Regression {
        dimension: cells[0],
        sex: cells[1],
        coefficients: [number(4), number(5), number(6)],
        sd_mm: number(7),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_man_of_the_survey_is_reproduced() {
        for (dimension, mean_mm) in [("neck_girth", 398.0), ("calf_girth", 392.0)] {
            let found = Regression::of(dimension, Sex::Male).unwrap();
            assert!((found.mean_mm(1756.2, 85.5) - mean_mm).abs() < 5.0);
            assert!((8.0..30.0).contains(&found.sd_mm));
        }
        assert_eq!(Regression::of("neck_girth", Sex::Neutral), None);
        assert_eq!(Regression::of("wing_span", Sex::Male), None);
    }
}
