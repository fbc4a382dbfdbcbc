//! Tape measurements of a body.
//!
//! Girths follow from the outlines of the silhouettes, not from the carved hull, whose corners stand out
//! (see `support`); the avatar tells where tapes lie and which outline belongs to which limb. Heights come
//! from the silhouettes where they show them, lengths from the avatar with the person's bones. What cannot
//! be had is left out with the reason.

mod figure;
mod lengths;
mod levels;
mod support;

use glam::DVec3;
use pirouette_geom::TriMesh;
use pirouette_geom::section::{plane_section, tape_length};
use rayon::prelude::*;
use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::avatar::{Avatar, render};
use crate::carve::CarveView;
use crate::skeleton::Bone;
pub use figure::measure_figure;
use support::{ExpectedTape, SeenView, find_lines, fit_girth};

/// A girth, by the key that files use; of the left and right limb where there are two, both have a loop
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum Girth {
    Neck,
    Bust,
    Waist,
    Hip,
    LeftThigh,
    RightThigh,
    LeftKnee,
    RightKnee,
    LeftCalf,
    RightCalf,
    LeftAnkle,
    RightAnkle,
    LeftUpperArm,
    RightUpperArm,
    LeftWrist,
    RightWrist,
}

/// A named point of the surface
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[allow(missing_docs, reason = "the names say it")]
pub enum Landmark {
    Crown,
    /// Seventh cervical vertebra, the nape
    Nape,
    LeftAcromion,
    RightAcromion,
    LeftBustPoint,
    RightBustPoint,
    /// Middle of the front at the natural waist
    WaistFront,
    /// Middle of the back at the natural waist
    WaistBack,
    /// Rearmost point of the seat
    Seat,
    Crotch,
    LeftWrist,
    RightWrist,
}

/// What is measured; girths are tape lengths, the perimeter of the section's convex hull
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Measure {
    /// Height of the person
    Stature,
    /// Around the neck below the larynx, across its axis
    NeckGirth,
    /// Level, over the bust points
    BustGirth,
    /// Level, at the natural waist, half way between lowest rib and hip bone
    WaistGirth,
    /// Level, over the rearmost point of the seat
    HipGirth,
    /// Level, right below the crotch
    ThighGirth,
    /// Level, over the middle of the kneecap
    KneeGirth,
    /// Level, where the lower leg is thickest
    CalfGirth,
    /// Level, where the lower leg is thinnest
    AnkleGirth,
    /// Half way from shoulder to elbow, across the arm
    UpperArmGirth,
    /// At the wrist, across the forearm
    WristGirth,
    /// From acromion over the nape to acromion
    ShoulderWidth,
    /// From shoulder joint over elbow to wrist
    ArmLength,
    /// From the nape down the middle of the back to the waist
    BackLength,
    /// Floor to crotch
    CrotchHeight,
    /// Floor to bust points
    BustHeight,
    /// Floor to natural waist
    WaistHeight,
    /// Floor to the rearmost point of the seat
    HipHeight,
}

impl Measure {
    /// All measures, in the order of files
    pub const ALL: [Measure; 18] = [
        Measure::Stature,
        Measure::NeckGirth,
        Measure::BustGirth,
        Measure::WaistGirth,
        Measure::HipGirth,
        Measure::ThighGirth,
        Measure::KneeGirth,
        Measure::CalfGirth,
        Measure::AnkleGirth,
        Measure::UpperArmGirth,
        Measure::WristGirth,
        Measure::ShoulderWidth,
        Measure::ArmLength,
        Measure::BackLength,
        Measure::CrotchHeight,
        Measure::BustHeight,
        Measure::WaistHeight,
        Measure::HipHeight,
    ];

    /// Key in files, in snake case
    pub fn name(self) -> &'static str {
        match self {
            Measure::Stature => "stature",
            Measure::NeckGirth => "neck_girth",
            Measure::BustGirth => "bust_girth",
            Measure::WaistGirth => "waist_girth",
            Measure::HipGirth => "hip_girth",
            Measure::ThighGirth => "thigh_girth",
            Measure::KneeGirth => "knee_girth",
            Measure::CalfGirth => "calf_girth",
            Measure::AnkleGirth => "ankle_girth",
            Measure::UpperArmGirth => "upper_arm_girth",
            Measure::WristGirth => "wrist_girth",
            Measure::ShoulderWidth => "shoulder_width",
            Measure::ArmLength => "arm_length",
            Measure::BackLength => "back_length",
            Measure::CrotchHeight => "crotch_height",
            Measure::BustHeight => "bust_height",
            Measure::WaistHeight => "waist_height",
            Measure::HipHeight => "hip_height",
        }
    }

    /// The tapes of a girth, left limb first; none for lengths and heights
    fn girths(self) -> &'static [Girth] {
        match self {
            Measure::NeckGirth => &[Girth::Neck],
            Measure::BustGirth => &[Girth::Bust],
            Measure::WaistGirth => &[Girth::Waist],
            Measure::HipGirth => &[Girth::Hip],
            Measure::ThighGirth => &[Girth::LeftThigh, Girth::RightThigh],
            Measure::KneeGirth => &[Girth::LeftKnee, Girth::RightKnee],
            Measure::CalfGirth => &[Girth::LeftCalf, Girth::RightCalf],
            Measure::AnkleGirth => &[Girth::LeftAnkle, Girth::RightAnkle],
            Measure::UpperArmGirth => &[Girth::LeftUpperArm, Girth::RightUpperArm],
            Measure::WristGirth => &[Girth::LeftWrist, Girth::RightWrist],
            _ => &[],
        }
    }
}

/// What to measure, all in the world frame, mm
#[derive(Debug, Clone, Copy)]
pub struct MeasureInput<'a> {
    /// The body
    pub body: &'a TriMesh,
    /// The fitted body, or the reference figure with the person's bone lengths, in the reference pose
    pub avatar: &'a Avatar,
    /// Whether the avatar is the person's own body
    pub fitted: bool,
    /// Silhouettes of the person in the reference pose, and how they were seen
    pub views: &'a [CarveView<'a>],
    /// Height of the person, if known
    pub stature_mm: Option<f64>,
}

/// How a value was found
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// It was given
    Given,
    /// From the outlines of several views, by Cauchy's formula
    SupportLines,
    /// Convex section of the carved hull, less what carving adds on average
    HullSection,
    /// Read off the silhouettes or the hull
    Silhouettes,
    /// From the avatar with the person's bone lengths
    Avatar,
}

/// Why a value is missing
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Unavailable {
    /// The avatar does not say where the tape goes
    #[error("the avatar has no tape loop or landmark for it")]
    NoLandmark,
    /// Neither outlines nor the hull show it
    #[error("too few views show it free of other limbs, and the carved body has no section there")]
    Hidden,
    /// There is no body to take it from
    #[error("the carved body is empty")]
    NoBody,
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
    /// Standard deviation of the value from the scatter of the outlines; scale and pose are not in it
    pub sd_mm: Option<f64>,
    /// Views that it rests on
    pub view_count: Option<usize>,
}

impl Measured {
    fn missing(why: Unavailable, method: Method) -> Self {
        Self {
            value_mm: Err(why),
            method,
            left_mm: None,
            right_mm: None,
            level_mm: None,
            sd_mm: None,
            view_count: None,
        }
    }

    fn of(value: Result<f64, Unavailable>, method: Method) -> Self {
        let missing = Self::missing(Unavailable::Hidden, method);
        Self {
            value_mm: value,
            ..missing
        }
    }
}

impl Serialize for Measured {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("method", &self.method)?;
        if let Err(why) = self.value_mm {
            map.serialize_entry("missing", &why.to_string())?;
        }
        for (key, value) in [
            ("left_mm", self.left_mm),
            ("right_mm", self.right_mm),
            ("level_mm", self.level_mm),
            ("sd_mm", self.sd_mm),
        ] {
            if let Some(value) = value {
                map.serialize_entry(key, &to_tenths(value))?;
            }
        }
        if let Some(views) = self.view_count {
            map.serialize_entry("views", &views)?;
        }
        map.end()
    }
}

/// Rounds to a tenth of a millimeter: what files show
fn to_tenths(value_mm: f64) -> f64 {
    (value_mm * 10.0).round() / 10.0
}

/// All measures of one person
#[derive(Debug, Clone, PartialEq)]
pub struct Measurements {
    values: Vec<(Measure, Measured)>,
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
}

impl Serialize for Measurements {
    /// As `{ "measurements_mm": { key: number or null }, "details": { key: { .. } } }`
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        struct Values<'a>(&'a Measurements);
        struct Details<'a>(&'a Measurements);
        impl Serialize for Values<'_> {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_map(
                    self.0
                        .iter()
                        .map(|(m, measured)| (m.name(), measured.value_mm.ok().map(to_tenths))),
                )
            }
        }
        impl Serialize for Details<'_> {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_map(self.0.iter().map(|(m, measured)| (m.name(), measured)))
            }
        }
        let mut map = serializer.serialize_map(Some(2))?;
        map.serialize_entry("measurements_mm", &Values(self))?;
        map.serialize_entry("details", &Details(self))?;
        map.end()
    }
}

/// Measures a body
///
/// Never fails as a whole: what cannot be had is missing with its reason.
pub fn measure(input: &MeasureInput) -> Measurements {
    let views: Vec<SeenView> = input
        .views
        .par_iter()
        .filter_map(|view| {
            let room_from_world = view.turn.room_from_world();
            let positions: Vec<DVec3> = input
                .avatar
                .mesh
                .positions
                .iter()
                .map(|p| room_from_world * *p)
                .collect();
            let expected =
                render::silhouette(&positions, &input.avatar.mesh.triangles, &view.camera);
            SeenView::new(view, expected)
        })
        .collect();
    let levels = levels::find(input.avatar, &views);
    let values = Measure::ALL.into_par_iter().map(|measure| {
        let measured = match measure {
            Measure::Stature => lengths::stature(input),
            Measure::ShoulderWidth => lengths::shoulder_width(input.avatar),
            Measure::ArmLength => lengths::arm_length(input.avatar),
            Measure::BackLength => lengths::back_length(input.avatar),
            Measure::CrotchHeight => levels.crotch,
            Measure::BustHeight => levels.bust,
            Measure::WaistHeight => levels.waist,
            Measure::HipHeight => levels.hip,
            _ => measure_girth(input, &levels, &views, measure),
        };
        (measure, measured)
    });
    Measurements {
        values: values.collect(),
    }
}

/// Direction that a tape runs around: up for trunk and legs, along the bone for arms, its own for the neck
fn tape_axis(avatar: &Avatar, girth: Girth) -> Option<DVec3> {
    let along = |from: Bone, to: Bone| {
        Some(avatar.bone_heads[to as usize] - avatar.bone_heads[from as usize])
    };
    match girth {
        Girth::Neck => None,
        Girth::LeftUpperArm => along(Bone::LeftUpperArm, Bone::LeftForearm),
        Girth::RightUpperArm => along(Bone::RightUpperArm, Bone::RightForearm),
        Girth::LeftWrist => along(Bone::LeftForearm, Bone::LeftHand),
        Girth::RightWrist => along(Bone::RightForearm, Bone::RightHand),
        _ => Some(DVec3::Y),
    }
}

/// The avatar's tape of a girth
fn expected_tape(avatar: &Avatar, girth: Girth) -> Option<ExpectedTape> {
    let tape = avatar.tape_loop(girth)?;
    let position = |v: &u32| avatar.mesh.positions.get(*v as usize).copied();
    let points: Option<Vec<DVec3>> = tape.vertices.iter().map(position).collect();
    ExpectedTape::new(&points?, tape_axis(avatar, girth))
}

/// One tape's length
struct Taped {
    girth_mm: f64,
    method: Method,
    level_mm: f64,
    sd_mm: Option<f64>,
    view_count: usize,
}

fn measure_girth(
    input: &MeasureInput,
    levels: &levels::Levels,
    views: &[SeenView],
    measure: Measure,
) -> Measured {
    let tape_of = |girth: &Girth| {
        let tape = expected_tape(input.avatar, *girth).ok_or(Unavailable::NoLandmark)?;
        let tape = levels.place(*girth, tape);
        best_level(*girth, &tape, input.body, views).ok_or(Unavailable::Hidden)
    };
    let tapes: Vec<Result<Taped, Unavailable>> = measure.girths().iter().map(tape_of).collect();
    let found: Vec<&Taped> = tapes.iter().flatten().collect();
    let Some(first) = found.first() else {
        let why = tapes.iter().find_map(|t| t.as_ref().err().copied());
        return Measured::missing(why.unwrap_or(Unavailable::NoLandmark), Method::SupportLines);
    };
    let mean =
        |value: fn(&Taped) -> f64| found.iter().map(|t| value(t)).sum::<f64>() / found.len() as f64;
    let of_side = |side: usize| {
        let tape = tapes.get(side).filter(|_| tapes.len() == 2)?;
        Some(tape.as_ref().ok()?.girth_mm)
    };
    let variances: Option<Vec<f64>> = found.iter().map(|t| Some(t.sd_mm?.powi(2))).collect();
    let by_lines = |t: &&Taped| t.method == Method::SupportLines;
    Measured {
        value_mm: Ok(mean(|t| t.girth_mm)),
        // The weaker method speaks for both.
        method: found.iter().find(|t| !by_lines(t)).unwrap_or(first).method,
        left_mm: of_side(0),
        right_mm: of_side(1),
        level_mm: Some(mean(|t| t.level_mm)),
        sd_mm: variances.map(|v| v.iter().sum::<f64>().sqrt() / v.len() as f64),
        view_count: found.iter().map(|t| t.view_count).min(),
    }
}

/// How far the thinnest and thickest places are looked for along a limb, in mm
const LEVEL_SEARCH_MM: f64 = 40.0;
/// Distance between the places looked at, in mm
const LEVEL_STEP_MM: f64 = 10.0;

/// The tape at its level, or for those defined as the thickest or thinnest place, the extreme near it
fn best_level(
    girth: Girth,
    tape: &ExpectedTape,
    body: &TriMesh,
    views: &[SeenView],
) -> Option<Taped> {
    let sign = match girth {
        Girth::LeftCalf | Girth::RightCalf => 1.0,
        Girth::LeftAnkle | Girth::RightAnkle => -1.0,
        _ => return tape_at(tape, body, views),
    };
    let steps = (LEVEL_SEARCH_MM / LEVEL_STEP_MM) as i32;
    let tapes: Vec<Taped> = (-steps..=steps)
        .filter_map(|step| {
            let by = tape.normal() * (f64::from(step) * LEVEL_STEP_MM);
            tape_at(&tape.moved(by), body, views)
        })
        .filter(|t| t.method == Method::SupportLines)
        .collect();
    // Where outlines are hidden, girths scatter, and the extreme would be the worst of them.
    const WORST_SD_RATIO: f64 = 1.5;
    let sd = |t: &Taped| t.sd_mm.unwrap_or(f64::INFINITY);
    let best_sd = tapes.iter().map(sd).fold(f64::INFINITY, f64::min);
    tapes
        .into_iter()
        .filter(|t| sd(t) <= WORST_SD_RATIO * best_sd)
        .max_by(|a, b| (sign * a.girth_mm).total_cmp(&(sign * b.girth_mm)))
        .or_else(|| tape_at(tape, body, views))
}

/// Uncertain beyond this part of the girth, support lines lose to the section of the hull
///
/// With half of the outlines hidden, a trunk's girth still has 2 %; limbs whose breadth alone is seen have 6 %.
const MAX_RELATIVE_SD: f64 = 0.12;

fn tape_at(tape: &ExpectedTape, body: &TriMesh, views: &[SeenView]) -> Option<Taped> {
    let level_mm = tape.center().y;
    let lines = find_lines(tape, views);
    let fitted = fit_girth(tape, &lines, views.len());
    if let Some(fitted) = fitted.filter(|f| f.sd_mm < MAX_RELATIVE_SD * f.girth_mm) {
        return Some(Taped {
            girth_mm: fitted.girth_mm,
            method: Method::SupportLines,
            level_mm,
            sd_mm: Some(fitted.sd_mm),
            view_count: fitted.view_count,
        });
    }
    let loops = plane_section(body, tape.center(), tape.normal());
    let nearest = loops.iter().min_by(|a, b| {
        let distance = |points: &[DVec3]| {
            (points.iter().sum::<DVec3>() / points.len() as f64).distance(tape.center())
        };
        distance(a).total_cmp(&distance(b))
    })?;
    // Another limb, or limbs that the hull melts together, would be far from what is expected.
    let length = tape_length(nearest);
    let plausible = (0.5..2.0).contains(&(length / tape.girth()));
    plausible.then(|| Taped {
        girth_mm: length / hull_excess(views),
        method: Method::HullSection,
        level_mm,
        sd_mm: None,
        view_count: views.len(),
    })
}

/// By how much the hull of a round body is longer around than the body itself
///
/// `n` evenly spread lines of sight turn a circle into a polygon with `2 n` sides; opposite views share a line.
fn hull_excess(views: &[SeenView]) -> f64 {
    use std::f64::consts::PI;
    /// Lines of sight nearer to each other than this count as one
    const SAME_LINE_RADIANS: f64 = 0.05;
    let mut lines: Vec<f64> = Vec::new();
    for view in views {
        let line = view.line_of_sight();
        let same = |other: &f64| {
            let difference = (line - other).abs();
            difference.min(PI - difference) < SAME_LINE_RADIANS
        };
        if !lines.iter().any(same) {
            lines.push(line);
        }
    }
    let n = lines.len().max(2) as f64;
    2.0 * n / PI * (PI / (2.0 * n)).tan()
}

#[cfg(test)]
mod tests;
