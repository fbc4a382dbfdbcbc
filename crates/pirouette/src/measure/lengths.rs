//! Lengths along the body: stature, shoulders, arms, back.

use glam::DVec3;
use pirouette_geom::section::plane_section;

use super::{Landmark, MeasureInput, Measured, Method, Unavailable};
use crate::avatar::Avatar;
use crate::skeleton::Bone;

/// The given stature, or else the height of the carved body
pub(super) fn stature(input: &MeasureInput) -> Measured {
    if let Some(given) = input.stature_mm {
        return Measured::of(Ok(given), Method::Given);
    }
    let top = input.body.bounds().map(|(_, hi)| hi.y);
    Measured::of(top.ok_or(Unavailable::NoBody), Method::Silhouettes)
}

/// From acromion to acromion over the nape, along the back
pub(super) fn shoulder_width(avatar: &Avatar) -> Measured {
    let ends = [Landmark::LeftAcromion, Landmark::RightAcromion].map(|l| avatar.landmark(l));
    let width = match (ends, avatar.landmark(Landmark::Nape)) {
        ([Some(left), Some(right)], Some(nape)) => {
            let normal = (left - nape).cross(right - nape);
            Ok(path_length(avatar, &[left, nape, right], normal))
        }
        _ => Err(Unavailable::NoLandmark),
    };
    Measured::of(width, Method::Avatar)
}

/// From the nape down the middle of the back to the waist
pub(super) fn back_length(avatar: &Avatar) -> Measured {
    let ends = [Landmark::Nape, Landmark::WaistBack].map(|l| avatar.landmark(l));
    let length = match ends {
        [Some(nape), Some(waist)] => Ok(path_length(avatar, &[nape, waist], DVec3::X)),
        _ => Err(Unavailable::NoLandmark),
    };
    Measured::of(length, Method::Avatar)
}

/// From the shoulder joint over the elbow to the wrist
pub(super) fn arm_length(avatar: &Avatar) -> Measured {
    let length = |bones: [Bone; 3]| {
        let [shoulder, elbow, wrist] = bones.map(|b| avatar.bone_heads[b as usize]);
        shoulder.distance(elbow) + elbow.distance(wrist)
    };
    let left = length([Bone::LeftUpperArm, Bone::LeftForearm, Bone::LeftHand]);
    let right = length([Bone::RightUpperArm, Bone::RightForearm, Bone::RightHand]);
    Measured {
        left_mm: Some(left),
        right_mm: Some(right),
        ..Measured::of(Ok((left + right) / 2.0), Method::Avatar)
    }
}

/// Length of the shorter way along the surface through points, in the plane through the first with this normal
///
/// The straight way where the surface has no such section.
fn path_length(avatar: &Avatar, points: &[DVec3], normal: DVec3) -> f64 {
    let straight: f64 = points.windows(2).map(|p| p[0].distance(p[1])).sum();
    let along: Option<f64> = points
        .windows(2)
        .map(|p| {
            // A tape bridges hollows, but is never much longer than the straight way on a back.
            const MAX_DETOUR: f64 = 1.25;
            let way = section_way(avatar, p[0], p[1], normal)?;
            (way < MAX_DETOUR * p[0].distance(p[1])).then_some(way)
        })
        .sum();
    along.unwrap_or(straight)
}

/// Length of the shorter way between two points along the section through both
fn section_way(avatar: &Avatar, from: DVec3, to: DVec3, normal: DVec3) -> Option<f64> {
    // Landmarks lie on the surface; a section that passes this far from one is another part's.
    const NEAR_MM: f64 = 15.0;
    plane_section(&avatar.mesh, from, normal)
        .iter()
        .filter_map(|points| {
            let nearest = |target: DVec3| {
                let distance = |i: &usize| points[*i].distance(target);
                let best = (0..points.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
                (points[best].distance(target) < NEAR_MM).then_some(best)
            };
            let (a, b) = (nearest(from)?, nearest(to)?);
            let way = |start: usize, end: usize| -> f64 {
                let count = (end + points.len() - start) % points.len();
                (start..start + count)
                    .map(|i| points[i % points.len()].distance(points[(i + 1) % points.len()]))
                    .sum()
            };
            Some(way(a, b).min(way(b, a)))
        })
        .min_by(f64::total_cmp)
}
