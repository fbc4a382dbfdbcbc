//! Heights of the level tapes, determined by the shape of the body.

use glam::DVec3;

use super::Body;
use super::slice::{Plane, Slicer};
use pirouette_body::Bone;

/// Height of the natural waist as a function of the crotch, both as shares of the stature: slope and offset
///
/// The middle between the tenth rib and the crest of the hip bone is not visible on the skin. In the ANSUR II survey,
/// for men and women alike, it lies at 0.520 crotch + 0.376 (standard deviation 0.0095). The tape is put one such
/// standard deviation lower, toward the navel: on bodies with known waists, the survey's middle is 10 to 20 mm too
/// high.
const WAIST_BY_CROTCH: [f64; 2] = [0.520, 0.3662];

/// Height of the rearmost point of the seat as a function of the crotch, both as shares of the stature (ANSUR II;
/// standard deviation 0.012)
const SEAT_BY_CROTCH: [f64; 2] = [0.779, 0.1343];

/// Range searched for the bust, below the armpits, as shares of the stature
///
/// In the ANSUR II survey the chest tape lies 0.022 below the armpit on men, 0.042 on women. Higher up, the roots of
/// the arms add 4 mm of girth per mm; lower down, bellies count as chests.
const BUST_ZONE: [f64; 2] = [0.05, 0.01];

/// Height of the armpits as a share of the stature (ANSUR II, mean of men and women), and by how much less is not unusual
const ARMPIT_USUAL: f64 = 0.759;
const ARMPIT_TOLERANCE: f64 = 0.012;

/// Position of armpits on bodies without arms and on those whose arms were lifted, as a share of the way from the upper
/// spine's head to the shoulders
const ARMPIT_FALLBACK: f64 = 0.47;

/// Half-width of the strip at the breast bone that contains no bust point, as a share of the stature
pub(super) const BUST_MIN_X: f64 = 0.015;

/// Half-width of the smoothing of chest profiles, as a share of the stature
const BUST_SMOOTHING: f64 = 0.012;

/// Points of the chest are weighted by `exp(-depth behind the foremost / this)`, a share of the stature (2 mm)
///
/// The foremost point itself jumps by 40 mm between two crests of equal depth; the weighted mean of all nearly foremost
/// points does not. With a larger value, the level of a pointed breast is biased to the middle of the zone.
const BUST_SOFTNESS: f64 = 0.001;

/// Range searched for the fold below the breast, below the bust points, as shares of the stature; its usual position,
/// and the standard deviation of that
const UNDERBUST_ZONE: [f64; 2] = [0.065, 0.02];
const UNDERBUST_USUAL: [f64; 2] = [0.042, 0.012];

/// Like [`BUST_SOFTNESS`], for the depth of the fold (4 mm): shallow folds have less weight than the usual position
const UNDERBUST_SOFTNESS: f64 = 0.0025;

/// Like [`BUST_SOFTNESS`], for the girth (20 mm): a taut tape slips from the slope of the breast to where it is shorter
const UNDERBUST_SLIP: f64 = 0.012;

/// Range searched for the seat, relative to the hip joints, as shares of the stature
const SEAT_ZONE: [f64; 2] = [-0.05, 0.045];

/// Points of a profile within this share of the stature (3 mm) of its extreme count as extreme: skin is flat there, and
/// the middle of the flat part varies less between bodies than its peak
const PLATEAU: f64 = 0.0018;

/// Range searched for the crotch, relative to the hip joints, as shares of the stature
const CROTCH_ZONE: [f64; 2] = [-0.12, 0.01];

/// Crotch below the hip joints, as a share of the stature, of people whose thighs do not touch: 0.037 to 0.042 on
/// mannequins of any sex, 0.045 to 0.047 on renders of the MakeHuman base mesh
const CROTCH_USUAL: f64 = 0.042;

/// Deviation from that at which the lower end of the trunk counts by half, as a share of the stature
const CROTCH_UNUSUAL: f64 = 0.012;

/// A narrowest place of the trunk is thinner than the ends of the range by this share
const NARROWEST_DEPTH: f64 = 0.01;

/// Step of the searches along the body, as a share of the stature
pub(super) const STEP: f64 = 0.001;

/// Heights of the level tapes, in mm
pub(super) struct Levels {
    pub(super) bust: f64,
    pub(super) underbust: f64,
    pub(super) waist: f64,
    pub(super) seat: f64,
    pub(super) crotch: DVec3,
    /// Lowest points where the arms touch the trunk
    pub(super) arms_part: f64,
    /// Below the armpits, above the bust
    pub(super) overbust: f64,
    /// Where the trunk is thinnest, if it is thicker above and below
    pub(super) narrowest_waist: Option<f64>,
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
        // The rearmost point varies by 20 mm with the hollow of the back, as much as the survey's bodies differ.
        let usual_seat = by_crotch(SEAT_BY_CROTCH);
        let seat = rearmost.map_or(usual_seat, |rearmost| (rearmost + usual_seat) / 2.0);

        let bust = bust(body);
        let underbust = underbust(body, bust);
        let waist = by_crotch(WAIST_BY_CROTCH);
        Self {
            bust,
            underbust,
            waist,
            seat,
            crotch,
            arms_part: armpit(body),
            overbust: bust_zone(body)[1].max(bust),
            narrowest_waist: narrowest(body, (waist + seat) / 2.0, underbust),
        }
    }
}

/// Returns where the legs part, behind thighs that touch
///
/// Thighs that touch hide the crotch: surfaces end where the thighs part, up to 0.11 of the stature below the hip joints.
/// Such a lower end counts less, the lower it is.
fn crotch(body: &Body<'_>, hips: DVec3) -> DVec3 {
    let usual = CROTCH_USUAL * body.stature;
    let Some(parting) = parting(body, hips) else {
        return hips - DVec3::Y * usual;
    };
    let below = hips.y - usual - parting.y;
    let weight = 1.0 / (1.0 + (below / (CROTCH_UNUSUAL * body.stature)).powi(8));
    let y = hips.y - usual - below * weight;
    DVec3::new(hips.x, y, parting.z)
}

/// Returns the lowest point of the line on the skin where the halves of the body meet; `None` if it is far from the hip
/// joints
///
/// The lower end of the mid plane may be lower, if it cuts a thigh.
pub(super) fn parting(body: &Body<'_>, hips: DVec3) -> Option<DVec3> {
    let [low, high] = CROTCH_ZONE.map(|share| hips.y + share * body.stature);
    let [armless, is_left] = [&body.armless, &body.is_left];
    let meet = |[a, b]: [usize; 2]| armless[a] && armless[b] && is_left[a] != is_left[b];
    let edges = body.surface.edges().map(|edge| edge.map(|v| v as usize));
    let points = edges.filter(|&edge| meet(edge)).map(|edge| {
        let [a, b] = edge.map(|v| body.mesh.positions[v]);
        let share = (hips.x - a.x) / (b.x - a.x);
        a.lerp(
            b,
            if share.is_finite() {
                share.clamp(0.0, 1.0)
            } else {
                0.5
            },
        )
    });
    points
        .filter(|p| (low..high).contains(&p.y))
        .min_by(|a, b| a.y.total_cmp(&b.y))
}

/// Returns the height at which armpits are expected: by the joints of spine and shoulders, and by the survey
///
/// Arms that touch the trunk are separated from it far below the armpits.
fn expected_armpit(body: &Body<'_>) -> f64 {
    let spine = body.head(Bone::UpperSpine).y;
    let shoulders = body.middle_of(Bone::LeftUpperArm, Bone::RightUpperArm).y;
    let by_joints = spine + ARMPIT_FALLBACK * (shoulders - spine);
    (by_joints + ARMPIT_USUAL * body.stature) / 2.0
}

/// Returns the height of the armpits: the lowest points where arms separate from the trunk, mean of both sides
fn armpit(body: &Body<'_>) -> f64 {
    let spine = body.head(Bone::UpperSpine).y;
    let shoulders = body.middle_of(Bone::LeftUpperArm, Bone::RightUpperArm).y;
    let lowest = |arm: &[bool]| {
        let parting = body
            .surface
            .edges()
            .filter(|edge| arm[edge[0] as usize] != arm[edge[1] as usize]);
        let heights = parting.map(|[a, b]| {
            (body.mesh.positions[a as usize].y + body.mesh.positions[b as usize].y) / 2.0
        });
        heights.reduce(f64::min)
    };
    match [&body.left, &body.right].map(|limbs| lowest(&limbs.arm_vertices)) {
        // Weights that extend far down the trunk do not mark armpits.
        [Some(left), Some(right)]
            if !body.lifted && left.min(right) > spine && left.max(right) < shoulders =>
        {
            (left + right) / 2.0
        }
        _ => spine + ARMPIT_FALLBACK * (shoulders - spine),
    }
}

/// Returns the range searched for the bust
fn bust_zone(body: &Body<'_>) -> [f64; 2] {
    let armpit = armpit(body);
    let highest = armpit.max(expected_armpit(body) - ARMPIT_TOLERANCE * body.stature);
    [
        armpit - BUST_ZONE[0] * body.stature,
        highest - BUST_ZONE[1] * body.stature,
    ]
}

/// Returns the height at which the trunk is thinnest; `None` if that is an end of the range
fn narrowest(body: &Body<'_>, low: f64, high: f64) -> Option<f64> {
    let surface = body.trunk.between(low, high);
    let girths = profile(&body.heights(low, high), |y| {
        Some(surface.girth(Plane::level(y))).filter(|&girth| girth > 0.0)
    });
    let thinnest = girths.iter().map(|&(_, girth)| girth).reduce(f64::min)?;
    let inside = |(_, girth): &(f64, f64)| *girth > thinnest * (1.0 + NARROWEST_DEPTH);
    if !(girths.first().is_some_and(inside) && girths.last().is_some_and(inside)) {
        return None;
    }
    let thickness: Vec<(f64, f64)> = girths.iter().map(|&(y, girth)| (y, -girth)).collect();
    plateau(&thickness, PLATEAU * body.stature)
}

/// Returns the height of the frontmost points next to the breast bone, mean of both sides
fn bust(body: &Body<'_>) -> f64 {
    let [low, high] = bust_zone(body);
    let reach_mm = BUST_SMOOTHING * body.stature;
    let sides = [1.0, -1.0].map(|outward| {
        let front = chest(body, [low - reach_mm, high + reach_mm], outward);
        let front = smoothed(&front, reach_mm);
        let zone: Vec<(f64, f64)> = front
            .into_iter()
            .filter(|(y, _)| (low..=high).contains(y))
            .collect();
        soft_top(&zone, BUST_SOFTNESS * body.stature)
    });
    match sides {
        [Some(left), Some(right)] => (left + right) / 2.0,
        [one, other] => one.or(other).unwrap_or((low + high) / 2.0),
    }
}

/// Returns the forward extent of the chest next to the breast bone on the left (`outward` 1) or on the right (-1)
fn chest(body: &Body<'_>, [low, high]: [f64; 2], outward: f64) -> Vec<(f64, f64)> {
    let middle = body.head(Bone::UpperSpine).x;
    let beside = |p: DVec3| (p.x - middle) * outward > BUST_MIN_X * body.stature;
    let surface = body.trunk.between(low, high);
    profile(&body.heights(low, high), |y| {
        reach(&surface, y, 1.0, beside)
    })
}

/// Returns the height of the tape below the breast: in the fold, where the profile is deepest behind the line from the
/// bust to the ribs, near its usual position, and where the tape is short
fn underbust(body: &Body<'_>, bust: f64) -> f64 {
    let [far, near] = UNDERBUST_ZONE.map(|share| bust - share * body.stature);
    let [usual, usual_sd] = UNDERBUST_USUAL.map(|share| share * body.stature);
    let [softness, slip] = [UNDERBUST_SOFTNESS, UNDERBUST_SLIP].map(|share| share * body.stature);
    let surface = body.trunk.between(far, bust);
    let girth = |y: f64| surface.girth(Plane::level(y));
    let sides = [1.0, -1.0].map(|outward| {
        let front = chest(body, [far, bust], outward);
        let (&(low, low_z), &(high, high_z)) = (front.first()?, front.last()?);
        let depth = |y: f64, z: f64| low_z + (high_z - low_z) * (y - low) / (high - low) - z;
        let unusual = |y: f64| ((y - (bust - usual)) / usual_sd).powi(2) / 2.0;
        let scores = front.iter().filter(|(y, _)| *y <= near).map(|&(y, z)| {
            let score = depth(y, z) / softness - girth(y) / slip - unusual(y);
            (y, score)
        });
        soft_top(&scores.collect::<Vec<_>>(), 1.0)
    });
    match sides {
        [Some(left), Some(right)] => (left + right) / 2.0,
        [one, other] => one.or(other).unwrap_or(bust - usual),
    }
}

/// A quantity at each height where it is defined
pub(super) fn profile(heights: &[f64], value: impl Fn(f64) -> Option<f64>) -> Vec<(f64, f64)> {
    heights
        .iter()
        .filter_map(|&y| Some((y, value(y)?)))
        .collect()
}

/// Returns the extent of a section along z, forward for `forward` 1 and backward for -1, among the points accepted by
/// `keep`
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

/// Averages a profile with its neighborhood, weighting nearer samples more
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

/// Returns the mean of the heights of a profile, each weighted by `exp(-distance below the maximum / softness)`; `None`
/// if empty
fn soft_top(profile: &[(f64, f64)], softness: f64) -> Option<f64> {
    let top = profile.iter().map(|&(_, value)| value).reduce(f64::max)?;
    let weighted = profile.iter().map(|&(y, value)| {
        let weight = ((value - top) / softness).exp();
        (weight, weight * y)
    });
    let (weights, sum) = weighted.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    Some(sum / weights).filter(|y| y.is_finite())
}

/// Returns the middle of the heights at which a profile is within `depth` of its maximum
fn plateau(profile: &[(f64, f64)], depth: f64) -> Option<f64> {
    let top = profile.iter().map(|&(_, value)| value).reduce(f64::max)?;
    let flat: Vec<f64> = profile
        .iter()
        .filter(|&&(_, value)| value >= top - depth)
        .map(|&(y, _)| y)
        .collect();
    Some(flat.iter().sum::<f64>() / flat.len() as f64)
}
