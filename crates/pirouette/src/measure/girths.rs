//! Girths: estimates from outlines and from the body, and their combination.

use std::f64::consts::PI;

use glam::DVec3;
use pirouette_geom::TriMesh;
use pirouette_geom::section::{plane_section, tape_length};

use super::lengths::{HIDDEN_CROTCH_MM, hidden_crotch};
use super::marked_avatar::{MarkedAvatar, moves_with_arms};
use super::support::{FittedGirth, SeenView, find_lines, fit_girth};
use super::tape::Tape;
use super::{BodySource, Estimate, Girth, Measure, MeasureInput, Measured, Method, Unavailable};
use pirouette_body::ReferencePose;

/// Largest standard deviation of a usable girth by support lines, as a share of the girth
///
/// With half of the outlines hidden, a trunk's girth still has 2 %; limbs of which only the breadth is visible have
/// 6 %.
const MAX_RELATIVE_SD: f64 = 0.12;

/// The estimates for one tape
struct TapeEstimates {
    lines: Option<Estimate>,
    body: Option<Estimate>,
    body_method: Method,
    level_mm: f64,
    view_count: usize,
}

impl TapeEstimates {
    fn both(&self) -> Option<Estimate> {
        match (self.lines, self.body) {
            (Some(lines), Some(body)) => Some(lines.settled(body)),
            (one, other) => one.or(other),
        }
    }

    fn method(&self) -> Method {
        match (self.lines, self.body) {
            (Some(_), Some(_)) => Method::Combined,
            (Some(_), None) => Method::SupportLines,
            _ => self.body_method,
        }
    }
}

/// Measures a girth, the mean of both sides where there are two
pub(super) fn measure_girth(
    input: &MeasureInput,
    avatar: &MarkedAvatar,
    views: &[SeenView],
    measure: Measure,
) -> Measured {
    let hidden_crotch = hidden_crotch(avatar);
    let tapes: Vec<Result<TapeEstimates, Unavailable>> = measure
        .girths()
        .iter()
        .map(|&girth| {
            let tape = avatar.tape(girth).ok_or(Unavailable::NoLandmark)?;
            let taped = tape_at(input, tape, girth, views, hidden_crotch);
            taped.both().map(|_| taped).ok_or(Unavailable::Hidden)
        })
        .collect();
    let found: Vec<&TapeEstimates> = tapes.iter().flatten().collect();
    let of = |which: fn(&TapeEstimates) -> Option<Estimate>| {
        let all: Option<Vec<Estimate>> = found.iter().map(|t| which(t)).collect();
        Estimate::mean(&all?)
    };
    let (Some(first), Some(value)) = (found.first(), of(TapeEstimates::both)) else {
        let why = tapes.iter().find_map(|t| t.as_ref().err().copied());
        let why = why.unwrap_or(Unavailable::NoLandmark);
        return Measured::of(Err(why), Method::SupportLines);
    };
    let of_side = |side: usize| {
        let tape = tapes.get(side).filter(|_| tapes.len() == 2)?;
        Some(tape.as_ref().ok()?.both()?.value_mm)
    };
    let (lines, body) = (of(|t| t.lines), of(|t| t.body));
    // The weaker method is reported for both.
    let method = found.iter().map(|t| t.method());
    let combined = |m: &Method| *m == Method::Combined;
    Measured {
        left_mm: of_side(0),
        right_mm: of_side(1),
        level_mm: Some(found.iter().map(|t| t.level_mm).sum::<f64>() / found.len() as f64),
        view_count: found.iter().map(|t| t.view_count).min(),
        contradicted: lines.zip(body).is_some_and(|(l, b)| l.contradicts(b)),
        lines,
        body,
        ..Measured::of(
            Ok(value),
            method
                .clone()
                .find(|m| !combined(m))
                .unwrap_or(first.method()),
        )
    }
}

/// Share of the standard deviation reported by a fit of lines that counts: its shape is that of the fitted body, its
/// priors are for bodies of any shape
const LINES_SD_SHARE: f64 = 0.2;

/// Standard deviation of girths by support lines and along the fitted body, as shares: two from photos, two by given
/// masks
///
/// The errors that remain in addition to the position of the tape: shape between the views, borders of masks. Chosen so
/// that 68 % of the errors of 100 random people lie within it. Wrists of the fitted body, however, have the shape of
/// the avatar that the fit started from. Random people made from the same avatar share it, others do not, so the body's
/// wrist has almost no weight.
fn own_sd(girth: Girth) -> [f64; 4] {
    match girth {
        Girth::Head => [0.0066, 0.0042, 0.0055, 0.0046],
        Girth::Neck => [0.0350, 0.0220, 0.0185, 0.0140],
        Girth::Bust => [0.0030, 0.0045, 0.0030, 0.0042],
        Girth::Underbust => [0.0030, 0.0033, 0.0020, 0.0020],
        Girth::Waist => [0.0040, 0.0040, 0.0033, 0.0032],
        Girth::Hip => [0.0040, 0.0032, 0.0034, 0.0029],
        Girth::LeftThigh | Girth::RightThigh => [0.0040, 0.0050, 0.0020, 0.0025],
        Girth::LeftKnee | Girth::RightKnee => [0.0030, 0.0035, 0.0025, 0.0030],
        Girth::LeftCalf | Girth::RightCalf => [0.0032, 0.0039, 0.0031, 0.0035],
        Girth::LeftAnkle | Girth::RightAnkle => [0.0042, 0.0060, 0.0040, 0.0057],
        Girth::LeftUpperArm | Girth::RightUpperArm => [0.0030, 0.0045, 0.0025, 0.0038],
        Girth::LeftWrist | Girth::RightWrist => [0.0170, 0.1000, 0.0035, 0.1000],
        Girth::Overbust => [0.0060, 0.0080, 0.0060, 0.0080],
        Girth::NarrowestWaist => [0.0040, 0.0040, 0.0033, 0.0032],
        Girth::HighHip => [0.0040, 0.0032, 0.0034, 0.0029],
        Girth::LeftMidThigh | Girth::RightMidThigh => [0.0040, 0.0050, 0.0020, 0.0025],
        Girth::LeftLowerKnee | Girth::RightLowerKnee => [0.0030, 0.0035, 0.0025, 0.0030],
        Girth::LeftElbow | Girth::RightElbow => [0.0060, 0.0090, 0.0050, 0.0076],
        Girth::LeftForearm | Girth::RightForearm => [0.0060, 0.0090, 0.0050, 0.0076],
    }
}

/// Standard deviation of a tape's position from its definition, in mm; multiplied by the girth slope it is an error of
/// the girth
///
/// Based on the errors of heights of random people, and of joints of arms along the arm. Waist and knee follow from
/// bones and crotch, which counts more if it is hidden, from 0 to 1.
fn level_sd_mm(girth: Girth, hidden_crotch: f64) -> f64 {
    let (own_mm, change_by_crotch) = match girth {
        // wherever they are thinnest or thickest
        Girth::Neck
        | Girth::NarrowestWaist
        | Girth::LeftLowerKnee
        | Girth::RightLowerKnee
        | Girth::LeftForearm
        | Girth::RightForearm => (0.0, 0.0),
        Girth::HighHip => (3.0, 0.45),
        Girth::LeftMidThigh | Girth::RightMidThigh => (3.0, 0.5),
        Girth::Waist => (2.0, 0.5),
        Girth::Hip => (3.0, 0.4),
        Girth::LeftThigh | Girth::RightThigh => (3.0, 1.0),
        Girth::LeftKnee | Girth::RightKnee => (2.0, 0.0),
        _ => (3.0, 0.0),
    };
    f64::hypot(own_mm, HIDDEN_CROTCH_MM * hidden_crotch * change_by_crotch)
}

/// Standard deviation caused by arms stretched out level, which spread the chest and shorten the neck, as a share of
/// the girth
///
/// With its arms lowered afterwards, the built-in mannequin in T-pose has a chest girth that is 2 % larger, from 0 to
/// 3.6 %.
const LIFTED_SD: f64 = 0.02;

/// Standard deviation of girths along carved hulls, as a share
const HULL_SD: f64 = 0.05;

fn tape_at(
    input: &MeasureInput,
    tape: &Tape,
    girth: Girth,
    views: &[SeenView],
    hidden_crotch: f64,
) -> TapeEstimates {
    let fitted = match girth {
        Girth::Neck => thinnest_by_lines(tape, views),
        _ => girth_by_lines(tape, views),
    };
    let [lines_sd, body_sd] = {
        let [lines, body, given_lines, given_body] = own_sd(girth);
        [
            input.between(lines, given_lines),
            input.between(body, given_body),
        ]
    };
    // Errors common to both estimates: the position of the tape, and lifted tissue
    let lifted = input.avatar.pose == ReferencePose::T && moves_with_arms(girth);
    let lifted_mm = if lifted {
        LIFTED_SD * tape.girth()
    } else {
        0.0
    };
    let place_mm = lifted_mm.hypot(tape.girth_slope() * level_sd_mm(girth, hidden_crotch));
    let lines = fitted.map(|f| Estimate {
        value_mm: f.girth_mm,
        sd_mm: match input.source {
            BodySource::Fitted => (LINES_SD_SHARE * f.sd_mm).hypot(lines_sd * f.girth_mm),
            BodySource::Hull => f.sd_mm.hypot(lines_sd * f.girth_mm),
        }
        .hypot(place_mm),
    });
    let (body, body_method) = match input.source {
        BodySource::Fitted => {
            let value_mm = tape.girth();
            let sd_mm = place_mm.hypot(body_sd * value_mm);
            (Some(Estimate { value_mm, sd_mm }), Method::BodyTape)
        }
        BodySource::Hull => (hull_girth(input.body, tape, views), Method::HullSection),
    };
    TapeEstimates {
        lines,
        body,
        body_method,
        level_mm: tape.center().y,
        view_count: fitted.map_or(0, |f| f.view_count),
    }
}

fn girth_by_lines(tape: &Tape, views: &[SeenView]) -> Option<FittedGirth> {
    let fitted = fit_girth(tape, &find_lines(tape, views), views.len());
    fitted.filter(|f| f.sd_mm < MAX_RELATIVE_SD * f.girth_mm)
}

/// Returns the smallest girth by lines around a tape: masks that fill the hollow of the neck move its thinnest point on
/// the body
fn thinnest_by_lines(tape: &Tape, views: &[SeenView]) -> Option<FittedGirth> {
    const STEP_MM: f64 = 5.0;
    /// Below this range the shoulders begin, above it the chin
    const STEPS: std::ops::RangeInclusive<i32> = -2..=4;
    /// Where outlines are hidden, girths scatter, and the smallest would be the worst of them
    const WORST_SD_RATIO: f64 = 1.5;
    let fitted: Vec<FittedGirth> = STEPS
        .filter_map(|step| {
            let by = tape.normal() * (f64::from(step) * STEP_MM);
            girth_by_lines(&tape.moved(by), views)
        })
        .collect();
    let best_sd = fitted.iter().map(|f| f.sd_mm).fold(f64::INFINITY, f64::min);
    fitted
        .into_iter()
        .filter(|f| f.sd_mm <= WORST_SD_RATIO * best_sd)
        .min_by(|a, b| a.girth_mm.total_cmp(&b.girth_mm))
}

/// Returns the section of the carved hull, less the excess of carving
fn hull_girth(body: &TriMesh, tape: &Tape, views: &[SeenView]) -> Option<Estimate> {
    let loops = plane_section(body, tape.center(), tape.normal());
    let nearest = loops.iter().min_by(|a, b| {
        let distance = |points: &[DVec3]| {
            (points.iter().sum::<DVec3>() / points.len() as f64).distance(tape.center())
        };
        distance(a).total_cmp(&distance(b))
    })?;
    // Another limb, or limbs merged by the hull, would differ far from the expected girth.
    let length = tape_length(nearest);
    let plausible = (0.5..2.0).contains(&(length / tape.girth()));
    let value_mm = length / hull_excess(views);
    plausible.then_some(Estimate {
        value_mm,
        sd_mm: HULL_SD * value_mm,
    })
}

/// Returns the ratio of the girth of a round body's hull to that of the body
///
/// `n` evenly spread lines of sight turn a circle into a polygon with `2 n` sides; opposite views share a line.
fn hull_excess(views: &[SeenView]) -> f64 {
    /// Lines of sight closer together than this count as one
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
