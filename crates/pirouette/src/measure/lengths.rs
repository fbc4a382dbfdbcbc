//! Heights above the floor and lengths along the body.

use glam::{DVec2, DVec3};
use pirouette_geom::section::{convex_hull, plane_section};

use super::marked_avatar::MarkedAvatar;
use super::tape::Tape;
use super::{
    BodySource, Estimate, Girth, Landmark, Measure, MeasureInput, Measured, Method, Unavailable,
};
use crate::scan::StatureFrom;
use pirouette_body::{Avatar, Bone, ReferencePose};

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

/// Returns whether a measure is a height above the floor, which shoes increase
pub(super) fn is_above_floor(measure: Measure) -> bool {
    matches!(
        measure,
        Measure::Stature
            | Measure::CrotchHeight
            | Measure::BustHeight
            | Measure::WaistHeight
            | Measure::HipHeight
            | Measure::NapeHeight
            | Measure::ShoulderHeight
            | Measure::UnderbustHeight
            | Measure::KneeHeight
            | Measure::NarrowestWaistHeight
    )
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
        Measure::NapeHeight => [5.0, 4.5],
        Measure::ShoulderHeight | Measure::NarrowestWaistHeight => [4.0, 3.5],
        Measure::UnderbustHeight => [4.2, 3.8],
        Measure::KneeHeight => [2.5, 2.2],
        Measure::ShoulderLength => [5.2, 5.2],
        Measure::UpperArmLength => [2.5, 3.2],
        Measure::NapeToWrist => [5.5, 5.5],
        Measure::AcrossBack => [9.5, 9.8],
        Measure::AcrossFront => [12.0, 10.0],
        Measure::BustSpan => [13.0, 9.0],
        Measure::SideNeckToBust => [6.0, 5.5],
        Measure::FrontLength => [4.2, 4.5],
        Measure::WaistToHip | Measure::BodyRise => [2.5, 2.5],
        Measure::WaistToKnee => [3.0, 3.0],
        Measure::FrontRise | Measure::BackRise => [5.0, 5.0],
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
        Measure::CrotchHeight => 1.0,
        // A tape between thighs that touch: on a real woman 30 to 100 mm shorter in photos than on her scan
        Measure::Rise => 6.0,
        Measure::FrontRise | Measure::BackRise => 3.0,
        Measure::WaistHeight | Measure::BodyRise | Measure::WaistToKnee | Measure::FrontLength => {
            0.5
        }
        Measure::HipHeight => 0.4,
        Measure::WaistToHip => 0.1,
        _ => 0.0,
    }
}

/// Returns the standard deviation caused by arms stretched out level, as a share of a length
///
/// With its arms lowered afterwards, the built-in mannequin in T-pose has these differences to one in A-pose.
pub(super) fn lifted_share(measure: Measure) -> f64 {
    match measure {
        Measure::ShoulderLength => 0.10,
        Measure::AcrossBack => 0.06,
        Measure::AcrossFront => 0.15,
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
    let lifted_mm = match input.avatar.pose {
        ReferencePose::A => 0.0,
        ReferencePose::T => lifted_share(measure) * value_mm,
    };
    let sd_mm = factor
        * input
            .between(photos, given)
            .hypot(hidden_mm)
            .hypot(lifted_mm);
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
        Measure::UnderbustHeight => level(Girth::Underbust),
        Measure::NarrowestWaistHeight => level(Girth::NarrowestWaist),
        Measure::NapeHeight => Some(vec![avatar.landmark(Landmark::Nape)?.y]),
        Measure::ShoulderHeight => both(|side| Some(side.acromion(avatar)?.y)),
        Measure::KneeHeight => both(|side| Some(avatar.tape(side.knee)?.center().y)),
        Measure::ShoulderLength => both(|side| shoulder_length(avatar, side)),
        Measure::UpperArmLength => both(|side| upper_arm_length(avatar, side)),
        Measure::NapeToWrist => nape_to_wrist(avatar),
        Measure::AcrossBack => across_trunk(avatar, -1.0).map(|v| vec![v]),
        Measure::AcrossFront => across_trunk(avatar, 1.0).map(|v| vec![v]),
        Measure::BustSpan => {
            let [left, right] = SIDES.map(|side| avatar.landmark(side.bust_point));
            Some(vec![left?.distance(right?)])
        }
        Measure::SideNeckToBust => both(|side| side_neck_to_bust(avatar, side)),
        Measure::FrontLength => both(|side| {
            let bust = avatar.landmark(side.bust_point)?;
            let waist = avatar.landmark(side.waist_front)?;
            let below = taut_below(avatar, bust, waist, DVec3::X, DVec3::Z)?;
            Some(side_neck_to_bust(avatar, side)? + below)
        }),
        Measure::WaistToHip => between(avatar, Measure::WaistHeight, Measure::HipHeight),
        Measure::BodyRise => between(avatar, Measure::WaistHeight, Measure::CrotchHeight),
        Measure::WaistToKnee => between(avatar, Measure::WaistHeight, Measure::KneeHeight),
        Measure::FrontRise => parts_of_rise(avatar).map(|[front, _]| vec![front]),
        Measure::BackRise => parts_of_rise(avatar).map(|[_, back]| vec![back]),
        _ => None,
    }
}

/// Landmarks, tapes and bones of one side
struct Side {
    acromion: Landmark,
    bust_point: Landmark,
    side_neck: Landmark,
    waist_front: Landmark,
    knee: Girth,
    elbow: Bone,
    upper_arm: Bone,
    /// +1 to the person's left
    outward: f64,
}

/// The left and the right side
const SIDES: [Side; 2] = [
    Side {
        acromion: Landmark::LeftAcromion,
        bust_point: Landmark::LeftBustPoint,
        side_neck: Landmark::LeftSideNeck,
        waist_front: Landmark::LeftWaistFront,
        knee: Girth::LeftKnee,
        elbow: Bone::LeftForearm,
        upper_arm: Bone::LeftUpperArm,
        outward: 1.0,
    },
    Side {
        acromion: Landmark::RightAcromion,
        bust_point: Landmark::RightBustPoint,
        side_neck: Landmark::RightSideNeck,
        waist_front: Landmark::RightWaistFront,
        knee: Girth::RightKnee,
        elbow: Bone::RightForearm,
        upper_arm: Bone::RightUpperArm,
        outward: -1.0,
    },
];

impl Side {
    fn acromion(&self, avatar: &MarkedAvatar) -> Option<DVec3> {
        avatar.landmark(self.acromion)
    }
}

/// Measures both sides, left first; `None` if one is missing
fn both(of_side: impl Fn(&Side) -> Option<f64>) -> Option<Vec<f64>> {
    SIDES.iter().map(of_side).collect()
}

/// Returns the vertical distance of two heights, the mean of both sides
fn between(avatar: &MarkedAvatar, high: Measure, low: Measure) -> Option<Vec<f64>> {
    let mean = |measure| {
        let sides = of_avatar(avatar, measure)?;
        Some(sides.iter().sum::<f64>() / sides.len() as f64)
    };
    Some(vec![mean(high)? - mean(low)?])
}

/// Measures from the side of the neck to the acromion, over the shoulder
fn shoulder_length(avatar: &MarkedAvatar, side: &Side) -> Option<f64> {
    let neck = avatar.landmark(side.side_neck)?;
    let acromion = side.acromion(avatar)?;
    taut_below(
        avatar,
        neck,
        acromion,
        (acromion - neck).cross(DVec3::Y),
        DVec3::Y,
    )
}

/// Measures from the acromion to the elbow joint
fn upper_arm_length(avatar: &MarkedAvatar, side: &Side) -> Option<f64> {
    let elbow = avatar.in_a_pose().bone_heads[side.elbow];
    Some(side.acromion(avatar)?.distance(elbow))
}

/// Measures from the nape over acromion and elbow to the wrist
fn nape_to_wrist(avatar: &MarkedAvatar) -> Option<Vec<f64>> {
    let half = shoulder_width(avatar)? / 2.0;
    let arms = shoulder_to_wrist(avatar)?;
    Some(arms.into_iter().map(|arm| half + arm).collect())
}

/// Measures from the side of the neck to the bust point
fn side_neck_to_bust(avatar: &MarkedAvatar, side: &Side) -> Option<f64> {
    let neck = avatar.landmark(side.side_neck)?;
    let bust = avatar.landmark(side.bust_point)?;
    // not over the chin, which is before the neck
    let nape = avatar.landmark(Landmark::Nape)?;
    let below = |p: DVec3| p.y < nape.y;
    let plane = ((bust - neck).cross(DVec3::Z), DVec3::Z);
    Some(path_length_2d(&taut_path(
        avatar, neck, bust, plane, below,
    )?))
}

/// Measures the taut tape over the back (`forward` -1) or the chest (1) from arm to arm, midway between acromion and
/// armpit
fn across_trunk(avatar: &MarkedAvatar, forward: f64) -> Option<f64> {
    let armpit = avatar.tape(Girth::Overbust)?.center().y;
    let [left, right] = SIDES.map(|side| side.acromion(avatar));
    let level = (armpit + (left?.y + right?.y) / 2.0) / 2.0;
    let body = avatar.in_a_pose();
    let [left, right] = SIDES.map(|side| arm_crease(body, level, forward, &side));
    let (left, right) = (left?, right?);
    taut_below(avatar, left, right, DVec3::Y, DVec3::Z * forward)
}

/// Returns the point of a level at the front or the back where the skin of an arm begins
fn arm_crease(body: &Avatar, level: f64, forward: f64, side: &Side) -> Option<DVec3> {
    let joint = body.bone_heads[side.upper_arm];
    let share = |v: u32| body.weights[v as usize].below(side.upper_arm);
    let position = |v: u32| body.mesh.positions[v as usize];
    let edges = body.mesh.triangles.iter();
    let edges = edges.flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    // Points of the section where the arm's share is one half, interpolated within triangles' sides
    let crossing = edges.filter_map(|[a, b]| {
        let (p, q) = (position(a), position(b));
        let along = (level - p.y) / (q.y - p.y);
        let within = (0.0..=1.0).contains(&along);
        within.then(|| (p.lerp(q, along), share(a) + (share(b) - share(a)) * along))
    });
    let on_side = crossing.filter(|(p, _)| (p.z - joint.z) * forward > 0.0);
    let of_trunk = on_side.filter(|(_, share)| *share < 0.5);
    let outward = |p: &DVec3| p.x * side.outward;
    of_trunk
        .map(|(p, _)| p)
        .max_by(|a, b| outward(a).total_cmp(&outward(b)))
}

/// Measures the parts of the rise before and behind the hip joints
fn parts_of_rise(avatar: &MarkedAvatar) -> Option<[f64; 2]> {
    let front = avatar.landmark(Landmark::WaistFront)?;
    let back = avatar.landmark(Landmark::WaistBack)?;
    let heads = &avatar.in_a_pose().bone_heads;
    let hips = (heads[Bone::LeftThigh] + heads[Bone::RightThigh]) / 2.0;
    let path = taut_path(avatar, front, back, (DVec3::X, -DVec3::Y), |_| true)?;
    let along = (back - front).try_normalize()?;
    let place = (hips - front).dot(along);
    let length = |from: f64, to: f64| -> f64 {
        let sides = path.windows(2).map(|side| {
            let (a, b) = (side[0], side[1]);
            let run = b.x - a.x;
            let inside = (b.x.min(to) - a.x.max(from)).max(0.0);
            // A side across the path belongs to the part that contains it.
            match run > 0.0 {
                true => a.distance(b) * inside / run,
                false if (from..to).contains(&a.x) => a.distance(b),
                false => 0.0,
            }
        });
        sides.sum()
    };
    Some([
        length(f64::NEG_INFINITY, place),
        length(place, f64::INFINITY),
    ])
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
    let path = taut_path(avatar, from, to, (normal, outward), |_| true)?;
    Some(path_length_2d(&path))
}

fn path_length_2d(path: &[DVec2]) -> f64 {
    path.windows(2).map(|side| side[0].distance(side[1])).sum()
}

/// Returns the corners of a taut tape like [`taut_below`], in its plane: distance along the straight line, and from it
///
/// Only points of the surface that `touches` accepts hold it.
fn taut_path(
    avatar: &MarkedAvatar,
    from: DVec3,
    to: DVec3,
    (normal, outward): (DVec3, DVec3),
    touches: impl Fn(DVec3) -> bool,
) -> Option<Vec<DVec2>> {
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
        .filter(|&&p| touches(p))
        .map(|&p| flat(p))
        .filter(|p| p.y >= 0.0 && (0.0..=length).contains(&p.x))
        .collect();
    points.extend([DVec2::ZERO, DVec2::new(length, 0.0)]);
    // Counter-clockwise, the straight line leads from the start to the end, and the tape back.
    let mut path = convex_hull(&points);
    let end = path.iter().position(|p| *p == DVec2::new(length, 0.0))?;
    path.rotate_left(end);
    path.reverse();
    Some(path)
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
