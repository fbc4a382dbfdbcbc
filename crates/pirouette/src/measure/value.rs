//! One measured value with its accuracy and sources; all values of one person.

use glam::DVec3;

use super::{BodyMass, Clothes, Girth, Measure};
use crate::scan::{StatureFrom, Subject};

/// Method by which a value was determined
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// It was given
    Given,
    /// From the size of a card or of a pixel
    Scale,
    /// From the outlines of several views, by Cauchy's formula
    SupportLines,
    /// Along a section of the fitted body
    BodyTape,
    /// Support lines and the section of the fitted body, weighted by their variances
    Combined,
    /// Convex section of the carved hull, less the average excess of carving
    HullSection,
    /// Measured on the body
    Body,
    /// From the avatar with the person's bone lengths
    Avatar,
    /// From pixels, combined with the statistics of a survey
    WithStatistics,
    /// Of the body below clothes or hair, from the statistics of a survey and all that is seen
    BelowClothes,
}

/// Why a value is missing
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Unavailable {
    /// The position of the tape on the avatar is undetermined
    #[error("the avatar has no section for this tape")]
    NoLandmark,
    /// Neither outlines nor the body show it
    #[error("too few views show it clear of other limbs, and the body has no section there")]
    Hidden,
    /// No body to measure it on
    #[error("the body is empty")]
    NoBody,
}

/// A value with its standard deviation, in mm
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The value
    pub value_mm: f64,
    /// Standard deviation
    pub sd_mm: f64,
}

impl Estimate {
    /// Correlation between the errors of two estimates from the same silhouettes
    ///
    /// (Errors of 100 random people correlate by 0.8 to 1 at trunk and legs, by 0.5 to 0.9 at neck and arms.)
    const CORRELATION: f64 = 0.9;

    /// Share of the difference of two contradicting estimates that is the standard deviation of the better one
    const CONTRADICTION_SHARE: f64 = 1.0 / 3.0;

    /// Combines the estimate by the outlines (`self`) with that of the body
    ///
    /// If they contradict each other, the outlines are wrong there, mostly by an arm that covers the gap to the trunk; the
    /// body is supported by all outlines and by its shape. Then the standard deviation contains the disagreement.
    pub(super) fn settled(self, body: Self) -> Self {
        if !self.contradicts(body) {
            return self.combined(body);
        }
        let disagreement = Self::CONTRADICTION_SHARE * (self.value_mm - body.value_mm);
        Self {
            value_mm: body.value_mm,
            sd_mm: body.sd_mm.hypot(disagreement),
        }
    }

    /// Returns the variance-weighted mean of two estimates
    pub(super) fn combined(self, other: Self) -> Self {
        let [a, b] = [self, other].map(|e| e.sd_mm.max(1e-6));
        let weight = b * b / (a * a + b * b);
        let rest = 1.0 - weight;
        let shared = 2.0 * weight * rest * Self::CORRELATION * a * b;
        let variance = (weight * a).powi(2) + (rest * b).powi(2) + shared;
        Self {
            value_mm: weight * self.value_mm + rest * other.value_mm,
            sd_mm: variance.sqrt(),
        }
    }

    /// Returns whether two estimates differ by more than twice their joint standard deviation
    pub(super) fn contradicts(self, other: Self) -> bool {
        (self.value_mm - other.value_mm).abs() > 2.0 * self.sd_mm.hypot(other.sd_mm)
    }

    /// Returns the mean of the same measure on both sides
    pub(super) fn mean(sides: &[Self]) -> Option<Self> {
        let count = sides.len() as f64;
        (!sides.is_empty()).then(|| Self {
            value_mm: sides.iter().map(|e| e.value_mm).sum::<f64>() / count,
            // Left and right are seen by the same views in the same way: their errors are fully correlated.
            sd_mm: sides.iter().map(|e| e.sd_mm).sum::<f64>() / count,
        })
    }
}

/// One measured value with its accuracy and sources, in mm
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The value, the mean for paired limbs; or the reason why it is missing
    pub value_mm: Result<f64, Unavailable>,
    /// Method by which it was determined
    pub method: Method,
    /// Value of the left limb
    pub left_mm: Option<f64>,
    /// Value of the right limb
    pub right_mm: Option<f64>,
    /// Height above the floor at which it was measured
    pub level_mm: Option<f64>,
    /// Standard deviation of the value, including the uncertainty of the scale
    pub sd_mm: Option<f64>,
    /// The component common to all values: the uncertainty of the scale
    pub scale_sd_mm: Option<f64>,
    /// Number of views whose outlines contribute
    pub view_count: Option<usize>,
    /// Estimate from support lines alone
    pub lines: Option<Estimate>,
    /// Estimate from the section of the body alone
    pub body: Option<Estimate>,
    /// Whether these two differ by more than their uncertainties allow
    pub contradicted: bool,
    /// Estimate from pixels alone, where statistics support the value, or of what covers the body
    pub pixels: Option<Estimate>,
    /// Expectation of the survey for people of this sex, stature and mass
    pub prior: Option<Estimate>,
}

impl Measured {
    pub(super) fn of(value: Result<Estimate, Unavailable>, method: Method) -> Self {
        Self {
            value_mm: value.map(|e| e.value_mm),
            method,
            left_mm: None,
            right_mm: None,
            level_mm: None,
            sd_mm: value.ok().map(|e| e.sd_mm),
            scale_sd_mm: None,
            view_count: None,
            lines: None,
            body: None,
            contradicted: false,
            pixels: None,
            prior: None,
        }
    }

    /// Returns the value with its standard deviation, if both are known
    pub fn estimate(&self) -> Option<Estimate> {
        Some(Estimate {
            value_mm: self.value_mm.ok()?,
            sd_mm: self.sd_mm?,
        })
    }

    /// Subtracts the thickness of the soles from a height above the floor
    pub(super) fn lowered_by(mut self, sole_mm: f64) -> Self {
        self.value_mm = self.value_mm.map(|value_mm| value_mm - sole_mm);
        for side in [&mut self.left_mm, &mut self.right_mm] {
            *side = side.map(|value_mm| value_mm - sole_mm);
        }
        self
    }

    /// Adds an independent standard deviation, a function of the value
    pub(super) fn with_more_sd(mut self, sd_mm: impl Fn(f64) -> f64) -> Self {
        if let (Ok(value), Some(sd)) = (self.value_mm, self.sd_mm) {
            self.sd_mm = Some(sd.hypot(sd_mm(value)));
        }
        self
    }

    /// Adds the uncertainty of the scale, a share of every length
    pub(super) fn with_scale_sd(mut self, scale_sd: f64) -> Self {
        if let (Ok(value), Some(sd)) = (self.value_mm, self.sd_mm) {
            let shared = value * scale_sd;
            self.sd_mm = Some(sd.hypot(shared));
            self.scale_sd_mm = Some(shared);
        }
        self
    }
}

/// Rounds to a tenth of a millimeter, the precision in files
fn to_tenths(value_mm: f64) -> f64 {
    (value_mm * 10.0).round() / 10.0
}

/// The unit in which lengths are reported
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LengthUnit {
    /// Millimeters, rounded to tenths
    Millimeter,
    /// The height of the person; values are in mm of a person of assumed height
    Stature(f64),
}

impl LengthUnit {
    /// Returns the suffix of keys
    pub fn suffix(self) -> &'static str {
        match self {
            LengthUnit::Millimeter => "_mm",
            LengthUnit::Stature(_) => "_per_stature",
        }
    }

    /// Converts a length in mm, rounded as in files
    pub fn convert(self, value_mm: f64) -> f64 {
        match self {
            LengthUnit::Millimeter => to_tenths(value_mm),
            LengthUnit::Stature(stature_mm) => (value_mm / stature_mm * 1e5).round() / 1e5,
        }
    }
}

/// All measures of one person
#[derive(Debug, Clone, PartialEq)]
pub struct Measurements {
    pub(super) values: Vec<(Measure, Measured)>,
    /// Source of the scale; `None` when unknown, and values are those of a person of assumed height
    pub stature: Option<StatureFrom>,
    /// Height of the avatar, in mm
    pub(super) height_mm: f64,
    /// Data given by the person
    pub subject: Subject,
    /// Volume and body mass, if there is a body and a scale
    pub mass: Option<BodyMass>,
    /// What the person wears, where the survey holds and the measures of the body are wanted
    pub clothes: Option<Clothes>,
    /// Positions of the tapes: closed curves, world frame, mm
    pub tapes: Vec<(Girth, Vec<DVec3>)>,
}

impl Measurements {
    /// Returns one measure with its details
    ///
    /// # Panics
    /// Never: all measures are present, missing ones with their reason.
    pub fn get(&self, measure: Measure) -> &Measured {
        let entry = self.values.iter().find(|(m, _)| *m == measure);
        &entry.expect("every measure has an entry").1
    }

    /// Returns the value in mm, `None` when it is missing
    pub fn value_mm(&self, measure: Measure) -> Option<f64> {
        self.get(measure).value_mm.ok()
    }

    /// Iterates over all measures in the order of files
    pub fn iter(&self) -> impl Iterator<Item = (Measure, &Measured)> {
        self.values
            .iter()
            .map(|(measure, measured)| (*measure, measured))
    }

    /// Returns whether the scale is known; otherwise values are those of a person of assumed height, and files store
    /// them in units of it
    pub fn in_mm(&self) -> bool {
        self.stature.is_some()
    }

    /// Formats a length for people: in mm, or in units of the stature
    pub fn format_length(&self, value_mm: f64) -> String {
        match self.unit() {
            LengthUnit::Millimeter => format!("{value_mm:6.0} mm"),
            unit => format!("{:6.4} of the stature", unit.convert(value_mm)),
        }
    }

    /// Returns the unit in which lengths are reported
    pub fn unit(&self) -> LengthUnit {
        match self.stature {
            Some(_) => LengthUnit::Millimeter,
            None => LengthUnit::Stature(self.height_mm),
        }
    }
}
