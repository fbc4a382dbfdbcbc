//! Body dimensions by sex, stature and mass, from regressions on the ANSUR II survey.
//!
//! # Source
//! Gordon et al. 2014, *2012 Anthropometric Survey of U.S. Army Personnel: Methods and Summary Statistics*,
//! Natick/TR-15/007. `assets/README.md` of this crate describes the fit. The survey measured upper arms and forearms
//! flexed; a mannequin's arms are relaxed.

use crate::Sex;
use crate::survey::Regression;

/// Ratio of the girth of a relaxed upper arm to that of a flexed one
///
/// Flexing adds 4 to 7 % in surveys that measured both.
const RELAXED_OVER_FLEXED_UPPER_ARM: f64 = 0.945;

/// Ratio of the girth of a relaxed forearm to that of a flexed one
const RELAXED_OVER_FLEXED_FOREARM: f64 = 0.965;

/// Declares the dimensions that the mannequin uses; the names are those of the table
macro_rules! dimensions {
    ($($name:ident),* $(,)?) => {
        /// Dimensions of one body, in mm; heights above the floor
        #[derive(Debug, Clone, PartialEq)]
        #[allow(missing_docs, reason = "the names are self-explanatory")]
        pub struct Proportions {
            $(pub $name: f64,)*
        }

        impl Proportions {
            fn from_lookup(dimension: impl Fn(&str) -> f64) -> Self {
                Self { $($name: dimension(stringify!($name)),)* }
            }

            /// Returns the same body scaled by `factor`
            pub fn scaled(mut self, factor: f64) -> Self {
                $(self.$name *= factor;)*
                self
            }
        }
    };
}

dimensions!(
    acromion_height,
    nape_height,
    sternum_height,
    axilla_height,
    chest_height,
    tenth_rib_height,
    waist_height,
    trochanter_height,
    buttock_height,
    crotch_height,
    knee_height,
    malleolus_height,
    biacromial_breadth,
    bideltoid_breadth,
    chest_depth,
    waist_breadth,
    waist_depth,
    hip_breadth,
    buttock_depth,
    neck_girth,
    chest_girth,
    waist_girth,
    hip_girth,
    thigh_girth,
    lower_thigh_girth,
    calf_girth,
    ankle_girth,
    biceps_flexed_girth,
    forearm_flexed_girth,
    wrist_girth,
    upper_arm_length,
    forearm_length,
    hand_length,
    hand_breadth,
    foot_length,
    foot_breadth,
    heel_breadth,
    head_breadth,
    head_length,
    face_height,
    crown_to_tragion,
    face_breadth,
    eye_distance,
    ear_length,
);

impl Proportions {
    /// Returns the mean dimensions of people of a given sex, stature and mass; neutral is the mean of both sexes
    ///
    /// # Panics
    /// Never: the table is part of the program and complete.
    pub fn regressed(sex: Sex, stature_mm: f64, mass_kg: f64) -> Self {
        let of_sex = |dimension: &str, sex: Sex| -> f64 {
            let regression = Regression::of(dimension, sex);
            let regression = regression.expect("the table has every dimension for both sexes");
            regression.mean_mm(stature_mm, mass_kg)
        };
        Self::from_lookup(|dimension| match sex {
            Sex::Neutral => (of_sex(dimension, Sex::Female) + of_sex(dimension, Sex::Male)) / 2.0,
            _ => of_sex(dimension, sex),
        })
    }

    /// Returns the girth of the relaxed upper arm halfway between shoulder and elbow, in mm
    pub fn upper_arm_girth(&self) -> f64 {
        RELAXED_OVER_FLEXED_UPPER_ARM * self.biceps_flexed_girth
    }

    /// Returns the largest girth of the relaxed forearm, in mm
    pub fn forearm_girth(&self) -> f64 {
        RELAXED_OVER_FLEXED_FOREARM * self.forearm_flexed_girth
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_of_the_survey_are_reproduced() {
        // Mean stature and mass of the men; their mean waist girth is 941 mm, hip girth 1020 mm.
        let men = Proportions::regressed(Sex::Male, 1756.2, 85.5);
        assert!((men.waist_girth - 941.0).abs() < 6.0, "{}", men.waist_girth);
        assert!((men.hip_girth - 1020.0).abs() < 5.0, "{}", men.hip_girth);
        assert!((men.crotch_height - 846.0).abs() < 3.0);
        let women = Proportions::regressed(Sex::Female, 1628.5, 67.8);
        assert!((women.chest_girth - 947.0).abs() < 6.0);
        assert!(
            (women.eye_distance - 61.5).abs() < 2.5,
            "{}",
            women.eye_distance
        );
    }

    #[test]
    fn neutral_lies_in_the_middle() {
        let [f, m, n] = [Sex::Female, Sex::Male, Sex::Neutral]
            .map(|sex| Proportions::regressed(sex, 1700.0, 64.0).hip_girth);
        assert!((n - (f + m) / 2.0).abs() < 1e-9);
        assert!(f > m);
    }
}
