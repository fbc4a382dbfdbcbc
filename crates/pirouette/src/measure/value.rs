//! One measured value and what is known about it; all values of one person.

use glam::DVec3;
use serde_json::{Map, Value, json};

use super::{BodyMass, Girth, Measure};
use crate::scan::{StatureFrom, Subject};
use crate::sizes::{Advice, Chart, ChartSex, advise};

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

/// In what lengths are told
#[derive(Debug, Clone, Copy)]
enum Unit {
    Millimeter,
    /// The height of the person, here in mm of a person of assumed height
    Stature(f64),
}

impl Unit {
    /// End of the names of keys
    fn suffix(self) -> &'static str {
        match self {
            Unit::Millimeter => "_mm",
            Unit::Stature(_) => "_per_stature",
        }
    }

    fn tell(self, value_mm: f64) -> f64 {
        match self {
            Unit::Millimeter => to_tenths(value_mm),
            Unit::Stature(stature_mm) => (value_mm / stature_mm * 1e5).round() / 1e5,
        }
    }
}

/// One measure as files show it
fn details(measure: Measure, measured: &Measured, unit: Unit) -> Value {
    let mut map = Map::new();
    map.insert("definition".into(), json!(measure.definition()));
    map.insert("method".into(), json!(measured.method));
    if let Err(why) = measured.value_mm {
        map.insert("missing".into(), json!(why.to_string()));
    }
    for (key, value) in [
        ("left", measured.left_mm),
        ("right", measured.right_mm),
        ("level", measured.level_mm),
        ("sd", measured.sd_mm),
        ("scale_sd", measured.scale_sd_mm),
    ] {
        if let Some(value) = value {
            map.insert(format!("{key}{}", unit.suffix()), json!(unit.tell(value)));
        }
    }
    if let Some(views) = measured.view_count {
        map.insert("views".into(), json!(views));
    }
    for (key, estimate) in [
        ("support_lines", measured.lines),
        ("body_tape", measured.body),
        ("pixels", measured.pixels),
        ("prior", measured.prior),
    ] {
        if let Some(Estimate { value_mm, sd_mm }) = estimate {
            let (suffix, value, sd) = (unit.suffix(), unit.tell(value_mm), unit.tell(sd_mm));
            let entry = [(&suffix[1..], value), (&format!("sd{suffix}")[..], sd)];
            let entry = entry.map(|(key, value)| (key.to_owned(), json!(value)));
            map.insert(key.into(), Value::Object(Map::from_iter(entry)));
        }
    }
    if measured.contradicted {
        map.insert("contradicted".into(), json!(true));
    }
    Value::Object(map)
}

/// All measures of one person
#[derive(Debug, Clone, PartialEq)]
pub struct Measurements {
    pub(super) values: Vec<(Measure, Measured)>,
    /// How the scale is known; `None` when it is not, and values are those of a person of assumed height
    pub(super) stature: Option<StatureFrom>,
    /// Height of the figure, in mm
    pub(super) height_mm: f64,
    /// What the person told
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

    /// Whether the scale is known; else values are those of a person of assumed height, and files tell them in units of it
    pub fn in_mm(&self) -> bool {
        self.stature.is_some()
    }

    /// A value as it is told to people: in mm, or in units of the stature
    pub fn told(&self, value_mm: f64) -> String {
        match self.unit() {
            Unit::Millimeter => format!("{value_mm:6.0} mm"),
            unit => format!("{:6.4} of the stature", unit.tell(value_mm)),
        }
    }

    fn unit(&self) -> Unit {
        match self.stature {
            Some(_) => Unit::Millimeter,
            None => Unit::Stature(self.height_mm),
        }
    }

    /// What the charts for a person of this sex say; all charts when it was not told
    pub fn advise(&self, charts: &[Chart]) -> Vec<Advice> {
        let sex = self.subject.sex.and_then(ChartSex::of);
        let fits = |chart: &&Chart| sex.is_none() || chart.sex.is_none() || chart.sex == sex;
        let dimension = |key: &str| {
            let (_, measured) = self.values.iter().find(|(m, _)| m.name() == key)?;
            let known = self.in_mm().then_some(measured.value_mm.ok()?)?;
            Some((known, measured.sd_mm?))
        };
        let charts = charts.iter().filter(fits);
        charts.map(|chart| advise(chart, &dimension)).collect()
    }

    /// As `measurements.json` holds it; `advice` are its sizes
    ///
    /// `{ "measurements_mm": { key: number or null }, "details": { key: { .. } }, .. }`
    pub fn to_json(&self, advice: &[Advice]) -> Value {
        let unit = self.unit();
        let values = |unit: Unit, known: bool| -> Map<String, Value> {
            let value = |m: &Measured| m.value_mm.ok().filter(|_| known).map(|v| unit.tell(v));
            let values = self.values.iter();
            values
                .map(|(measure, found)| (measure.name().to_owned(), json!(value(found))))
                .collect()
        };
        let details: Map<String, Value> = self
            .values
            .iter()
            .map(|(m, found)| (m.name().to_owned(), details(*m, found, unit)))
            .collect();
        let mut file = json!({
            "measurements_mm": values(Unit::Millimeter, self.in_mm()),
            "unit": if self.in_mm() { "mm" } else { "stature" },
            "scale": match self.stature {
                Some(StatureFrom::Stated) => "stature",
                Some(StatureFrom::Card) => "card",
                Some(StatureFrom::PixelSize) => "mm_per_px",
                None => "unknown: give the stature, camera.mm_per_px, or --scale card",
            },
        });
        if !self.in_mm() {
            file["measurements_per_stature"] = Value::Object(values(unit, true));
        }
        if let Some(mass) = &self.mass {
            file["body"] = mass.to_json();
        }
        let Subject {
            sex,
            mass_kg,
            age_years,
        } = self.subject;
        if sex.is_some() || mass_kg.is_some() || age_years.is_some() {
            file["subject"] = json!({
                "sex": sex.map(|sex| sex.name()),
                "mass_kg": mass_kg,
                "age_years": age_years,
            });
        }
        if !advice.is_empty() {
            file["sizes"] = json!(advice);
        }
        file["details"] = Value::Object(details);
        file
    }
}
