//! Heights of the level tapes, by the shape of the body.

use glam::DVec3;

use super::Body;
use super::slice::{Plane, Slicer};
use crate::skeleton::Bone;

/// Natural waist by the crotch, both as shares of the stature: slope and offset
///
/// The middle between the tenth rib and the crest of the hip bone is not seen on skin. In the ANSUR II survey, men and
/// women alike, it lies at 0.520 crotch + 0.376 (standard deviation 0.0095). The tape is put one such deviation lower,
/// toward the navel: on bodies with known waists, the survey's middle is 10 to 20 mm too high.
const WAIST_BY_CROTCH: [f64; 2] = [0.520, 0.3662];

/// Rearmost point of the seat by the crotch, both as shares of the stature (ANSUR II; standard deviation 0.012)
const SEAT_BY_CROTCH: [f64; 2] = [0.779, 0.1343];

/// Where the bust is sought, as shares of the way from the upper spine's head to the shoulders, and where it is put
/// on bodies whose chest does not stand out
const BUST_ZONE: [f64; 2] = [0.2, 0.75];
const BUST_FALLBACK: f64 = 0.47;

/// The strip beside the breast bone in which no bust point lies, as a share of the stature
pub(super) const BUST_MIN_X: f64 = 0.015;

/// Profiles of the chest are smoothed over so much to either side, as a share of the stature
///
/// Less, and which of two crests of one breast is higher moves the tape by 40 mm.
const BUST_SMOOTHING: f64 = 0.012;

/// Where the fold below the breast is sought, below the bust points, as shares of the stature, and where it is put on
/// chests without one
const UNDERBUST_ZONE: [f64; 2] = [0.02, 0.065];
const UNDERBUST_FALLBACK: f64 = 0.042;

/// Where the seat is sought, relative to the hip joints, as shares of the stature
const SEAT_ZONE: [f64; 2] = [-0.05, 0.045];

/// Points of a profile within this share of the stature (3 mm) of its extreme are as extreme: skin is flat there, and the middle of the
/// flat part moves less from body to body than its peak
const PLATEAU: f64 = 0.0018;

/// Where the crotch is sought, relative to the hip joints, as shares of the stature
const CROTCH_ZONE: [f64; 2] = [-0.11, 0.01];

/// Step of the searches along the body, as a share of the stature
pub(super) const STEP: f64 = 0.001;

/// Heights of the level tapes, in mm
pub(super) struct Levels {
    pub(super) bust: f64,
    pub(super) underbust: f64,
    pub(super) waist: f64,
    pub(super) seat: f64,
    pub(super) crotch: DVec3,
}

impl Levels {
    pub(super) fn find(body: &Body<'_>) -> Self {
        let stature = body.stature;
        let hips = body.middle_of(Bone::LeftThigh, Bone::RightThigh);
        let crotch = crotch(body, hips);
        let by_crotch = |[slope, offset]: [f64; 2]| slope * crotch.y + offset * stature;

        let [low, high] = SEAT_ZONE.map(|share| hips.y + share * stature);
        let surface = body.trunk.between(low, high);
        let back = profile(&body.heights(low, high), |y| {
            reach(&surface, y, -1.0, |_| true)
        });
        let rearmost = plateau(&back, PLATEAU * stature);
        // The rearmost point wanders by 20 mm with the hollow of the back, as much as the survey's bodies differ.
        let usual_seat = by_crotch(SEAT_BY_CROTCH);
        let seat = rearmost.map_or(usual_seat, |rearmost| (rearmost + usual_seat) / 2.0);

        let bust = bust(body);
        Self {
            bust,
            underbust: underbust(body, bust),
            waist: by_crotch(WAIST_BY_CROTCH),
            seat,
            crotch,
        }
    }
}

/// Where the mid plane of the trunk ends below
fn crotch(body: &Body<'_>, hips: DVec3) -> DVec3 {
    let [low, high] = CROTCH_ZONE.map(|share| hips.y + share * body.stature);
    let mid_plane = Plane {
        origin: hips,
        normal: DVec3::X,
    };
    let points = body.trunk.cut(mid_plane).into_iter().map(|c| c.point);
    points
        .filter(|p| (low..high).contains(&p.y))
        .min_by(|a, b| a.y.total_cmp(&b.y))
        .unwrap_or(DVec3::new(hips.x, low, hips.z))
}

/// Height of the most forward points beside the breast bone, mean of both sides
fn bust(body: &Body<'_>) -> f64 {
    let shoulders = body.middle_of(Bone::LeftUpperArm, Bone::RightUpperArm);
    let spine = body.head(Bone::UpperSpine);
    let chest = |share: f64| spine.y + share * (shoulders.y - spine.y);
    let [low, high] = BUST_ZONE.map(chest);
    let heights = body.heights(low, high);
    let surface = body.trunk.between(low, high);
    let side_level = |outward: f64| {
        let beside = |p: DVec3| (p.x - spine.x) * outward > BUST_MIN_X * body.stature;
        let front = profile(&heights, |y| reach(&surface, y, 1.0, beside));
        let front = smoothed(&front, BUST_SMOOTHING * body.stature);
        flat_top(&front, PLATEAU * body.stature)
    };
    match (side_level(1.0), side_level(-1.0)) {
        (Some(left), Some(right)) => (left + right) / 2.0,
        (Some(one), None) | (None, Some(one)) => one,
        (None, None) => chest(BUST_FALLBACK),
    }
}

/// Height of the fold below the breast: where the profile lies deepest behind the line from the bust to the ribs
fn underbust(body: &Body<'_>, bust: f64) -> f64 {
    /// A fold is deeper than this share of the stature; else it is put where it usually is
    const LEAST_DEPTH: f64 = 0.0006;
    let [near, far] = UNDERBUST_ZONE.map(|share| share * body.stature);
    let surface = body.trunk.between(bust - far, bust);
    let middle = body.head(Bone::UpperSpine).x;
    let beside = |p: DVec3| (p.x - middle).abs() > BUST_MIN_X * body.stature;
    let front = profile(&body.heights(bust - far, bust), |y| {
        reach(&surface, y, 1.0, beside)
    });
    let (Some(&(low, low_z)), Some(&(high, high_z))) = (front.first(), front.last()) else {
        return bust - UNDERBUST_FALLBACK * body.stature;
    };
    let depth = |(y, z): (f64, f64)| low_z + (high_z - low_z) * (y - low) / (high - low) - z;
    let inside = front.iter().filter(|&&(y, _)| y <= bust - near);
    let deepest = inside.max_by(|a, b| depth(**a).total_cmp(&depth(**b)));
    match deepest {
        Some(&fold) if depth(fold) > LEAST_DEPTH * body.stature => fold.0,
        _ => bust - UNDERBUST_FALLBACK * body.stature,
    }
}

/// A quantity at each height where there is one
pub(super) fn profile(heights: &[f64], value: impl Fn(f64) -> Option<f64>) -> Vec<(f64, f64)> {
    heights
        .iter()
        .filter_map(|&y| Some((y, value(y)?)))
        .collect()
}

/// How far a section reaches along z, forward for `forward` 1 and backward for -1, among the points that `keep` allows
pub(super) fn reach(
    surface: &Slicer<'_>,
    y: f64,
    forward: f64,
    keep: impl Fn(DVec3) -> bool,
) -> Option<f64> {
    surface
        .cut(Plane::level(y))
        .iter()
        .filter(|c| keep(c.point))
        .map(|c| c.point.z * forward)
        .reduce(f64::max)
}

/// A profile averaged with its surroundings, nearer ones more
fn smoothed(profile: &[(f64, f64)], reach: f64) -> Vec<(f64, f64)> {
    let at = |y: f64| {
        let weighted = profile.iter().map(|&(other, value)| {
            let weight = (1.0 - (other - y).abs() / reach).max(0.0);
            (weight, weight * value)
        });
        let (weights, sum) = weighted.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        sum / weights
    };
    profile.iter().map(|&(y, _)| (y, at(y))).collect()
}

/// The middle of the flat part around the highest local maximum inside a profile, `None` when it only rises or falls
fn flat_top(profile: &[(f64, f64)], depth: f64) -> Option<f64> {
    let inside = (1..profile.len().checked_sub(1)?).filter(|&i| {
        let [before, here, after] = [i - 1, i, i + 1].map(|i| profile[i].1);
        before <= here && here >= after
    });
    let top = inside.max_by(|&a, &b| profile[a].1.total_cmp(&profile[b].1))?;
    let flat = |(_, value): &&(f64, f64)| *value >= profile[top].1 - depth;
    let below = profile[..top].iter().rev().take_while(flat).last();
    let above = profile[top..].iter().take_while(flat).last();
    let (low, high) = (
        below.unwrap_or(&profile[top]),
        above.unwrap_or(&profile[top]),
    );
    Some((low.0 + high.0) / 2.0)
}

/// The middle of the heights at which a profile is within `depth` of its maximum
fn plateau(profile: &[(f64, f64)], depth: f64) -> Option<f64> {
    let top = profile.iter().map(|&(_, value)| value).reduce(f64::max)?;
    let flat: Vec<f64> = profile
        .iter()
        .filter(|&&(_, value)| value >= top - depth)
        .map(|&(y, _)| y)
        .collect();
    Some(flat.iter().sum::<f64>() / flat.len() as f64)
}
