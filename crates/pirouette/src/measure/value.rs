//! One measured value and what is known about it; all values of one person.

use glam::DVec3;

use super::{BodyMass, Girth, Measure};
use crate::scan::{StatureFrom, Subject};

/// How a value was found
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
    /// Support lines and the section of the fitted body, by their variances
    Combined,
    /// Convex section of the carved hull, less what carving adds on average
    HullSection,
    /// Read off the body
    Body,
    /// From the reference figure with the person's bone lengths
    Avatar,
    /// From pixels, supported by the statistics of a survey
    WithStatistics,
}

/// Why a value is missing
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Unavailable {
    /// The figure does not say where the tape goes
    #[error("the figure has no place for this tape")]
    NoLandmark,
    /// Neither outlines nor the body show it
    #[error("too few views show it free of other limbs, and the body has no section there")]
    Hidden,
    /// There is no body to take it from
    #[error("the body is empty")]
    NoBody,
}

/// A value with its standard deviation, in mm
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The value
    pub value_mm: f64,
    /// Its standard deviation
    pub sd_mm: f64,
}

impl Estimate {
    /// How much two estimates that see the same silhouettes have their errors in common
    ///
    /// (Errors of 100 random people correlate by 0.8 to 1 at trunk and legs, by 0.5 to 0.9 at neck and arms.)
    const CORRELATION: f64 = 0.9;

    /// The mean of two estimates by their variances
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

    /// Whether two estimates differ by more than twice what both allow
    pub(super) fn contradicts(self, other: Self) -> bool {
        (self.value_mm - other.value_mm).abs() > 2.0 * self.sd_mm.hypot(other.sd_mm)
    }

    /// The mean of the same measure on both sides
    pub(super) fn mean(sides: &[Self]) -> Option<Self> {
        let count = sides.len() as f64;
        (!sides.is_empty()).then(|| Self {
            value_mm: sides.iter().map(|e| e.value_mm).sum::<f64>() / count,
            // Left and right are seen by the same views in the same way: their errors go together.
            sd_mm: sides.iter().map(|e| e.sd_mm).sum::<f64>() / count,
        })
    }
}

/// One measured value with what is known about it, in mm
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The value: of two limbs the mean; or why there is none
    pub value_mm: Result<f64, Unavailable>,
    /// How it was found
    pub method: Method,
    /// Left limb's own
    pub left_mm: Option<f64>,
    /// Right limb's own
    pub right_mm: Option<f64>,
    /// Height above the floor at which it was taken
    pub level_mm: Option<f64>,
    /// Standard deviation of the value, the uncertainty of the scale included
    pub sd_mm: Option<f64>,
    /// The part of it that all values share: the uncertainty of the scale
    pub scale_sd_mm: Option<f64>,
    /// Views whose outlines it rests on
    pub view_count: Option<usize>,
    /// What support lines alone say
    pub lines: Option<Estimate>,
    /// What the section of the body alone says
    pub body: Option<Estimate>,
    /// Whether these two differ by more than both allow
    pub contradicted: bool,
    /// What pixels alone say, where statistics support the value
    pub pixels: Option<Estimate>,
    /// What the survey says about people of this sex, stature and mass
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

/// Rounds to a tenth of a millimeter: what files show
fn to_tenths(value_mm: f64) -> f64 {
    (value_mm * 10.0).round() / 10.0
}

/// The unit in which lengths are reported
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LengthUnit {
    /// Millimeters, rounded to tenths
    Millimeter,
    /// The height of the person, here in mm of a person of assumed height
    Stature(f64),
}

impl LengthUnit {
    /// End of the names of keys
    pub fn suffix(self) -> &'static str {
        match self {
            LengthUnit::Millimeter => "_mm",
            LengthUnit::Stature(_) => "_per_stature",
        }
    }

    /// Converts a length in mm, rounded as files show it
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
    /// How the scale is known; `None` when it is not, and values are those of a person of assumed height
    pub stature: Option<StatureFrom>,
    /// Height of the figure, in mm
    pub(super) height_mm: f64,
    /// Data given about the person
    pub subject: Subject,
    /// Volume and body mass, where there is a body and a scale
    pub mass: Option<BodyMass>,
    /// Where the tapes went: closed curves, world frame, mm
    pub tapes: Vec<(Girth, Vec<DVec3>)>,
}

impl Measurements {
    /// One measure with its details
    ///
    /// # Panics
    /// Never: all measures are there, missing ones with their reason.
    pub fn get(&self, measure: Measure) -> &Measured {
        let entry = self.values.iter().find(|(m, _)| *m == measure);
        &entry.expect("every measure has an entry").1
    }

    /// The value in mm, `None` when it is missing
    pub fn value_mm(&self, measure: Measure) -> Option<f64> {
        self.get(measure).value_mm.ok()
    }

    /// All measures in the order of files
    pub fn iter(&self) -> impl Iterator<Item = (Measure, &Measured)> {
        self.values
            .iter()
            .map(|(measure, measured)| (*measure, measured))
    }

    /// Whether the scale is known; else values are those of a person of assumed height, and files give them in units of it
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

    /// The unit in which lengths are reported
    pub fn unit(&self) -> LengthUnit {
        match self.stature {
            Some(_) => LengthUnit::Millimeter,
            None => LengthUnit::Stature(self.height_mm),
        }
    }
}
