//! The subject of a scan: sex and stance.

/// Sex of a mannequin; neutral is halfway between the average woman and the average man
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub enum Sex {
    Female,
    Male,
    #[default]
    Neutral,
}

impl Sex {
    /// Returns the name used in files
    pub fn name(self) -> &'static str {
        match self {
            Sex::Female => "female",
            Sex::Male => "male",
            Sex::Neutral => "neutral",
        }
    }

    /// Returns the mean stature of the people in the survey, in mm
    pub fn mean_stature_mm(self) -> f64 {
        match self {
            Sex::Female => 1628.0,
            Sex::Male => 1756.0,
            Sex::Neutral => 1692.0,
        }
    }
}

/// The pose in which people stand and to which their silhouettes are normalized
///
/// A relaxed stance: elbows bent forward, legs a little apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ReferencePose {
    /// Arms stretched down and out
    #[default]
    A,
    /// Arms stretched out level
    T,
}

impl ReferencePose {
    /// Returns the angle of the upper arms below the horizontal, in degrees
    pub fn arm_angle_degrees(self) -> f64 {
        match self {
            ReferencePose::A => 48.0,
            ReferencePose::T => 0.0,
        }
    }

    /// Returns the angle by which the forearms point forward out of the frontal plane, in degrees
    pub fn elbow_bend_degrees(self) -> f64 {
        43.0
    }
}
