//! Heights above the floor and lengths along the body.

use glam::{DVec2, DVec3};
use pirouette_geom::section::{convex_hull, perimeter, plane_section};

use super::marked_avatar::MarkedAvatar;
use super::tape::Tape;
use super::{
    BodySource, Estimate, Girth, Landmark, Measure, MeasureInput, Measured, Method, Unavailable,
};
use crate::scan::StatureFrom;
use pirouette_body::Bone;

/// Standard deviation of the scale by a card, as a share: the remaining effect of tilt and of edges a few pixels long
const CARD_SCALE_SD: f64 = 0.01;

/// Standard deviation of the scale by a stated size of pixels
const PIXEL_SCALE_SD: f64 = 0.005;

/// Standard deviation of a stated stature of unknown accuracy, in mm
///
/// People shrink by 10 to 20 mm over the day, round, and overstate their stature by 16 mm (men) and 10 mm (women) on
/// average (Scholes et al. 2022, 38,942 people). With 9 mm, girths of people whose stature was 30 mm too small were off by
/// up to 3.4 of their standard deviations.
const STATED_STATURE_SD_MM: f64 = 12.0;

/// Returns the standard deviation of the scale, as a share of all lengths
pub(super) fn scale_sd(input: &MeasureInput) -> f64 {
    match (input.stature_mm, input.stature_from) {
        (Some(stature_mm), StatureFrom::Stated) => {
            let stated = input.subject.stature_sd_mm;
            stated.unwrap_or(STATED_STATURE_SD_MM) / stature_mm
        }
        (Some(_), StatureFrom::Card) => CARD_SCALE_SD,
        (Some(_), StatureFrom::PixelSize) => PIXEL_SCALE_SD,
        (Some(_), StatureFrom::Mesh) => 0.0,
        // Lengths in units of the stature need no scale.
        (None, _) => 0.0,
    }
}

/// Returns the given stature, otherwise the height of the body
pub(super) fn stature(input: &MeasureInput) -> Measured {
    let exact = |value_mm| Estimate {
        value_mm,
        sd_mm: 0.0,
    };
    if let Some(given) = input.stature_mm {
        let method = match input.stature_from {
            StatureFrom::Stated => Method::Given,
            StatureFrom::Card | StatureFrom::PixelSize => Method::Scale,
            StatureFrom::Mesh => Method::Body,
        };
        return Measured::of(Ok(exact(given)), method);
    }
    let height = input.body.bounds().map(|(lo, hi)| hi.y - lo.y);
    Measured::of(height.map(exact).ok_or(Unavailable::NoBody), Method::Body)
}

/// Standard deviation of a height or length on the fitted body, in mm: from photos, and by given masks
///
/// Chosen so that 68 % of the errors of random people lie within it.
fn own_sd(measure: Measure) -> [f64; 2] {
    match measure {
        Measure::ShoulderWidth => [7.9, 8.3],
        Measure::BackLength | Measure::NapeToWaist => [5.5, 4.8],
        Measure::CrotchHeight => [4.1, 3.7],
        Measure::BustHeight => [4.2, 3.8],
        Measure::WaistHeight => [2.5, 2.0],
        Measure::HipHeight => [3.0, 3.1],
        Measure::FootLength => [2.4, 1.9],
        Measure::Rise => [5.0, 5.5],
        Measure::ArmLength => [4.8, 5.3],
        Measure::ShoulderToWrist => [4.5, 4.5],
        _ => [8.0, 8.0],
    }
}

/// Additional standard deviation of a crotch that is hidden between thighs that touch, in mm
///
/// It is then placed by the hip joints: the distance varies by 5 mm between families of bodies, and detectors place hips by
/// other rules.
pub(super) const HIDDEN_CROTCH_MM: f64 = 7.0;

/// Returns whether the crotch is hidden between thighs: 0 where they are apart, 1 where they touch
///
/// Judged by their girth relative to the stature.
pub(super) fn hidden_crotch(avatar: &MarkedAvatar) -> f64 {
    const APART: f64 = 0.335;
    const TOUCHING: f64 = 0.365;
    let girths =
        [Girth::LeftThigh, Girth::RightThigh].map(|girth| avatar.tape(girth).map(Tape::girth));
    let girth = girths.into_iter().flatten().fold(0.0, f64::max);
    let share = girth / avatar.in_a_pose().stature_mm();
    ((share - APART) / (TOUCHING - APART)).clamp(0.0, 1.0)
}

/// Returns the change of a measure with the crotch
pub(super) fn change_by_crotch(measure: Measure) -> f64 {
    match measure {
        Measure::CrotchHeight | Measure::Rise => 1.0,
        Measure::WaistHeight => 0.5,
        Measure::HipHeight => 0.4,
        _ => 0.0,
    }
}

/// Factor on these standard deviations for an avatar that is not the person's body
const UNFITTED: f64 = 2.0;

/// Measures a height or a length
pub(super) fn measure_length(
    input: &MeasureInput,
    avatar: &MarkedAvatar,
    measure: Measure,
) -> Measured {
    let (method, factor) = match input.source {
        BodySource::Fitted => (Method::Body, 1.0),
        BodySource::Hull => (Method::Avatar, UNFITTED),
    };
    let Some(sides) = of_avatar(avatar, measure) else {
        return Measured::of(Err(Unavailable::NoLandmark), method);
    };
    let of_side = |side: usize| sides.get(side).filter(|_| sides.len() == 2).copied();
    let value_mm = sides.iter().sum::<f64>() / sides.len() as f64;
    let [photos, given] = own_sd(measure);
    let hidden_mm = HIDDEN_CROTCH_MM * hidden_crotch(avatar) * change_by_crotch(measure);
    let sd_mm = factor * input.between(photos, given).hypot(hidden_mm);
    Measured {
        left_mm: of_side(0),
        right_mm: of_side(1),
        ..Measured::of(Ok(Estimate { value_mm, sd_mm }), method)
    }
}

/// Measures a height or a length on an avatar, left and right where there are two
pub(super) fn of_avatar(avatar: &MarkedAvatar, measure: Measure) -> Option<Vec<f64>> {
    let level = |girth| Some(vec![avatar.tape(girth)?.center().y]);
    match measure {
        Measure::BustHeight => level(Girth::Bust),
        Measure::WaistHeight => level(Girth::Waist),
        Measure::HipHeight => level(Girth::Hip),
        Measure::CrotchHeight => Some(vec![avatar.landmark(Landmark::Crotch)?.y]),
        Measure::ShoulderWidth => shoulder_width(avatar).map(|v| vec![v]),
        Measure::BackLength => nape_to_waist(avatar, true).map(|v| vec![v]),
        Measure::NapeToWaist => nape_to_waist(avatar, false).map(|v| vec![v]),
        Measure::Rise => rise(avatar).map(|v| vec![v]),
        Measure::ArmLength => Some(arm_length(avatar)),
        Measure::ShoulderToWrist => shoulder_to_wrist(avatar),
        Measure::FootLength => foot_length(avatar),
        _ => None,
    }
}

/// Measures from acromion to acromion over the nape, a taut tape over the back
fn shoulder_width(avatar: &MarkedAvatar) -> Option<f64> {
    let nape = avatar.landmark(Landmark::Nape)?;
    let sides = [Landmark::LeftAcromion, Landmark::RightAcromion].map(|l| avatar.landmark(l));
    let [left, right] = [sides[0]?, sides[1]?];
    let normal = (left - nape).cross(right - nape);
    // Outward is upward and backward, where the tape is in contact with the skin.
    let outward = DVec3::Y - DVec3::Z;
    let half = |end: DVec3| {
        taut_below(avatar, nape, end, normal, outward).unwrap_or_else(|| nape.distance(end))
    };
    Some(half(left) + half(right))
}

/// Measures from the nape down the middle of the back to the waist: along the skin, or taut
fn nape_to_waist(avatar: &MarkedAvatar, taut: bool) -> Option<f64> {
    let nape = avatar.landmark(Landmark::Nape)?;
    let waist = avatar.landmark(Landmark::WaistBack)?;
    Some(match taut {
        true => taut_below(avatar, nape, waist, DVec3::X, -DVec3::Z)
            .unwrap_or_else(|| nape.distance(waist)),
        false => path_length(avatar, &[nape, waist], DVec3::X),
    })
}

/// Measures from the waist in front between the legs to the waist behind
fn rise(avatar: &MarkedAvatar) -> Option<f64> {
    let front = avatar.landmark(Landmark::WaistFront)?;
    let back = avatar.landmark(Landmark::WaistBack)?;
    taut_below(avatar, front, back, DVec3::X, -DVec3::Y)
}

/// Returns the length of a taut tape between two points in the plane through the first, on the side of `outward`
fn taut_below(
    avatar: &MarkedAvatar,
    from: DVec3,
    to: DVec3,
    normal: DVec3,
    outward: DVec3,
) -> Option<f64> {
    let loops = plane_section(&avatar.in_a_pose().mesh, from, normal);
    let along = (to - from).try_normalize()?;
    let side = (outward - along * outward.dot(along)).try_normalize()?;
    let length = (to - from).length();
    let flat = |p: DVec3| DVec2::new((p - from).dot(along), (p - from).dot(side));
    let center = (from + to) / 2.0;
    let nearest = loops.iter().min_by(|a, b| {
        let distance = |points: &[DVec3]| {
            points
                .iter()
                .map(|p| p.distance(from).min(p.distance(center) + length))
                .fold(f64::INFINITY, f64::min)
        };
        distance(a).total_cmp(&distance(b))
    })?;
    let mut points: Vec<DVec2> = nearest
        .iter()
        .map(|&p| flat(p))
        .filter(|p| p.y >= 0.0 && (0.0..=length).contains(&p.x))
        .collect();
    points.extend([DVec2::ZERO, DVec2::new(length, 0.0)]);
    Some(perimeter(&convex_hull(&points)) - length)
}

/// Measures from the shoulder joint over the elbow to the wrist joint
fn arm_length(avatar: &MarkedAvatar) -> Vec<f64> {
    let length = |bones: [Bone; 3]| {
        let [shoulder, elbow, wrist] = bones.map(|b| avatar.in_a_pose().bone_heads[b]);
        shoulder.distance(elbow) + elbow.distance(wrist)
    };
    vec![
        length([Bone::LeftUpperArm, Bone::LeftForearm, Bone::LeftHand]),
        length([Bone::RightUpperArm, Bone::RightForearm, Bone::RightHand]),
    ]
}

/// Measures from the acromion over the elbow joint to the outer side of the wrist
fn shoulder_to_wrist(avatar: &MarkedAvatar) -> Option<Vec<f64>> {
    [
        (
            Landmark::LeftAcromion,
            Bone::LeftForearm,
            Landmark::LeftWrist,
        ),
        (
            Landmark::RightAcromion,
            Bone::RightForearm,
            Landmark::RightWrist,
        ),
    ]
    .into_iter()
    .map(|(acromion, elbow, wrist)| {
        let elbow = avatar.in_a_pose().bone_heads[elbow];
        let (acromion, wrist) = (avatar.landmark(acromion)?, avatar.landmark(wrist)?);
        Some(acromion.distance(elbow) + elbow.distance(wrist))
    })
    .collect()
}

/// Measures the extent of each foot along the line from the heel to the toes
fn foot_length(avatar: &MarkedAvatar) -> Option<Vec<f64>> {
    let avatar = avatar.in_a_pose();
    [Bone::LeftFoot, Bone::RightFoot]
        .into_iter()
        .map(|foot| {
            let points: Vec<DVec2> = avatar
                .mesh
                .positions
                .iter()
                .zip(&avatar.weights)
                .filter(|(_, weight)| weight.below(foot) >= 0.5)
                .map(|(p, _)| DVec2::new(p.x, p.z))
                .collect();
            let hull = convex_hull(&points);
            // The longest distance across a foot runs from the heel to the toes.
            let pairs = hull
                .iter()
                .flat_map(|a| hull.iter().map(move |b| a.distance(*b)));
            pairs.reduce(f64::max)
        })
        .collect()
}

/// Returns the length of the shorter path along the surface through points, in the plane through the first with this
/// normal
///
/// Falls back to the straight distance where the surface has no such section.
fn path_length(avatar: &MarkedAvatar, points: &[DVec3], normal: DVec3) -> f64 {
    let straight: f64 = points.windows(2).map(|p| p[0].distance(p[1])).sum();
    let along: Option<f64> = points
        .windows(2)
        .map(|p| {
            // A tape bridges hollows, but on a back it is never much longer than the straight distance.
            const MAX_DETOUR: f64 = 1.25;
            let way = section_way(avatar, p[0], p[1], normal)?;
            (way < MAX_DETOUR * p[0].distance(p[1])).then_some(way)
        })
        .sum();
    along.unwrap_or(straight)
}

/// Returns the length of the shorter path between two points along the section through both
fn section_way(avatar: &MarkedAvatar, from: DVec3, to: DVec3, normal: DVec3) -> Option<f64> {
    // Landmarks lie on the surface; a section that passes this far from one belongs to another part.
    const NEAR_MM: f64 = 15.0;
    plane_section(&avatar.in_a_pose().mesh, from, normal)
        .iter()
        .filter_map(|points| {
            let [(a, off_a), (b, off_b)] = [place_along(points, from)?, place_along(points, to)?];
            let way = (a - b).abs();
            let sides = points.iter().zip(points.iter().cycle().skip(1));
            let around: f64 = sides.map(|(p, q)| p.distance(*q)).sum();
            let near = off_a < NEAR_MM && off_b < NEAR_MM;
            near.then_some(way.min(around - way))
        })
        .min_by(f64::total_cmp)
}

/// Finds the point of a closed curve nearest to a point: the length of the curve up to it, and its distance
fn place_along(points: &[DVec3], target: DVec3) -> Option<(f64, f64)> {
    let mut before = 0.0;
    let sides = points.iter().zip(points.iter().cycle().skip(1));
    let places = sides.map(|(&start, &end)| {
        let side = end - start;
        let length = side.length();
        let share = ((target - start).dot(side) / length.powi(2).max(1e-12)).clamp(0.0, 1.0);
        let place = before + share * length;
        before += length;
        (place, target.distance(start + side * share))
    });
    places.min_by(|a, b| a.1.total_cmp(&b.1))
}
