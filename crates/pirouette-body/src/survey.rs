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

const CORRELATIONS: &str = include_str!("../assets/ansur2_correlations.csv");

/// Rows of sex and dimension with the correlations to all dimensions, in the order of the rows of one sex
static CORRELATION_ROWS: LazyLock<Vec<(&str, &str, Vec<f64>)>> = LazyLock::new(|| {
    CORRELATIONS
        .lines()
        .skip(1)
        .map(parse_correlations)
        .collect()
});

/// Minimum stature and age of the people for whom the survey holds: its soldiers are 17 to 58 years old, and the smallest
/// is 1409 mm tall
const MIN_STATURE_MM: f64 = 1400.0;
const MIN_AGE_YEARS: f64 = 17.0;

/// Returns whether statistics of the survey hold for a person, as far as stature and age are known
pub fn holds_for(stature_mm: f64, age_years: Option<f64>) -> bool {
    stature_mm >= MIN_STATURE_MM && age_years.is_none_or(|age| age >= MIN_AGE_YEARS)
}

/// Returns the correlation of two dimensions of people of one sex, stature and mass; `None` for dimensions without one
pub fn correlation(a: &str, b: &str, sex: Sex) -> Option<f64> {
    let of_sex = || CORRELATION_ROWS.iter().filter(|row| row.0 == sex.name());
    let column = of_sex().position(|row| row.1 == b)?;
    let row = of_sex().find(|row| row.1 == a)?;
    row.2.get(column).copied()
}

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

    /// Returns the change per meter of stature, at the same mass over stature, in mm
    pub fn per_m_stature(&self) -> f64 {
        self.coefficients[1]
    }

    /// Returns the change per unit of the square root of mass in kg over stature in m, in mm
    pub fn per_build(&self) -> f64 {
        self.coefficients[2]
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

fn parse_correlations(row: &'static str) -> (&'static str, &'static str, Vec<f64>) {
    let mut cells = row.split(',');
    let mut name = || cells.next().unwrap_or_default();
    let (sex, dimension) = (name(), name());
    let number = |cell: &str| cell.parse().expect("the table has numbers");
    (sex, dimension, cells.map(number).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlations_are_symmetric_and_those_of_the_survey() {
        for sex in [Sex::Female, Sex::Male] {
            let names = || CORRELATION_ROWS.iter().filter(|r| r.0 == sex.name());
            assert_eq!(names().count(), 12);
            for (_, a, _) in names() {
                assert_eq!(correlation(a, a, sex), Some(1.0));
                assert!(Regression::of(a, sex).is_some(), "{a}");
                for (_, b, _) in names() {
                    assert_eq!(correlation(a, b, sex), correlation(b, a, sex));
                }
            }
            // Firm calves have firm ankles.
            let found = correlation("calf_girth", "ankle_girth", sex).unwrap();
            assert!((0.4..0.8).contains(&found), "{found}");
        }
        assert_eq!(correlation("neck_girth", "wing_span", Sex::Male), None);
        assert_eq!(correlation("neck_girth", "calf_girth", Sex::Neutral), None);
    }

    #[test]
    fn the_survey_holds_for_adults_of_its_statures() {
        assert!(holds_for(1600.0, None) && holds_for(1600.0, Some(44.0)));
        assert!(!holds_for(1600.0, Some(14.0)));
        assert!(!holds_for(1310.0, None));
    }

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
