//! Makes the surface of a file one closed surface, and checks that it is that of a person.

use glam::DVec3;
use pirouette_geom::TriMesh;
use pirouette_geom::isosurface::{SurfaceOptions, extract_surface};
use pirouette_geom::nearest::NearestSurface;
use pirouette_geom::winding::WindingNumbers;

use super::surface::Surface;
use super::{AllWeights, LoadAvatarError};
use crate::{Avatar, Bone, PerBone};

/// Cells of the hull along its longest side, so that a stray vertex far away does not increase their number
///
/// 9 mm for a person; the fit moves the surface by more than what the chamfered fingers lose.
const CELLS: f64 = 200.0;

/// Minimum height of the hull as a share of that of all parts; the largest connected piece of a lower one is a leg
const MIN_HULL_HEIGHT: f64 = 0.9;

/// Winding number at the surface of the hull
const LEVEL: f64 = 0.5;

/// Largest distance of the middle of a limb's bone from the surface, as a share of the stature
///
/// The thickest thighs have a radius of 0.08.
const MAX_LIMB_RADIUS: f64 = 0.12;

/// Bones of the limbs with their lower ends, on the left
const LIMBS: [(Bone, Bone); 4] = [
    (Bone::LeftUpperArm, Bone::LeftForearm),
    (Bone::LeftForearm, Bone::LeftHand),
    (Bone::LeftThigh, Bone::LeftShin),
    (Bone::LeftShin, Bone::LeftFoot),
];

/// What the surface of a file was before it was replaced by its outer hull
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "the surface is not closed ({part_count} parts, {open_edge_count} open edges); used its outer hull with a resolution of {resolution_mm:.0} mm"
)]
pub struct HullUsed {
    /// Number of connected parts
    pub part_count: usize,
    /// Number of edges of a single triangle
    pub open_edge_count: usize,
    /// Edge length of the cells of the hull, in mm
    pub resolution_mm: f64,
}

/// Replaces a surface that is not one closed surface by its outer hull: where the winding number exceeds one half
pub(super) fn close(surface: &mut Surface) -> Result<Option<HullUsed>, LoadAvatarError> {
    surface.compact();
    let mesh = surface.mesh();
    let (low, high) = mesh.bounds().ok_or(LoadAvatarError::Degenerate)?;
    let finite = surface.positions.iter().all(|p| p.is_finite());
    if !(finite && high.y > low.y) {
        return Err(LoadAvatarError::Degenerate);
    }
    let part_count = mesh.components().len();
    if part_count == 1 && mesh.check().is_ok() {
        return Ok(None);
    }
    let neighbors = mesh.neighbors();
    let open_edge_count = neighbors.iter().flatten().filter(|n| n.is_none()).count();
    let resolution_mm = (high - low).max_element() / CELLS;
    let winding = WindingNumbers::new(&mesh);
    let nearest = NearestSurface::new(&mesh);
    let field = |p: DVec3| {
        let distance = nearest
            .nearest(p)
            .map_or(f64::INFINITY, |found| found.distance);
        // Not zero on walls inside the hull, which are no part of its surface
        if winding.at(p) > LEVEL {
            -distance.max(1e-9)
        } else {
            distance
        }
    };
    let options = SurfaceOptions {
        lo: low - 2.0 * resolution_mm,
        hi: high + 2.0 * resolution_mm,
        cell_size: resolution_mm,
        lipschitz: 1.0,
        secant_steps: 1,
        thin_pieces: false,
    };
    let hull =
        extract_surface(field, &options).map_err(|_too_large| LoadAvatarError::Degenerate)?;
    let hull = hull.largest_component();
    let height = |(low, high): (DVec3, DVec3)| high.y - low.y;
    let hull_height = hull.bounds().map_or(0.0, height);
    if hull.check().is_err() || hull_height < MIN_HULL_HEIGHT * (high.y - low.y) {
        return Err(LoadAvatarError::NoHull { part_count });
    }
    surface.weights = hull
        .positions
        .iter()
        .map(|&p| weights_at(surface, &nearest, p))
        .collect();
    surface.positions = hull.positions;
    surface.triangles = hull.triangles;
    Ok(Some(HullUsed {
        part_count,
        open_edge_count,
        resolution_mm,
    }))
}

/// Returns the weights of the surface at the point nearest to `p`
fn weights_at(surface: &Surface, nearest: &NearestSurface, p: DVec3) -> AllWeights {
    let mut sum = PerBone::splat(0.0);
    let Some(found) = nearest.nearest(p) else {
        return sum;
    };
    let triangle = surface.triangles[found.triangle];
    let [a, b, c] = triangle.map(|v| surface.positions[v as usize]);
    // Barycentric coordinates by the areas of the parts
    let part = |b: DVec3, c: DVec3| (b - found.position).cross(c - found.position).length();
    let parts = [part(b, c), part(c, a), part(a, b)];
    let total: f64 = parts.iter().sum();
    for (vertex, part) in triangle.into_iter().zip(parts) {
        let share = if total > 0.0 { part / total } else { 1.0 / 3.0 };
        let weights = surface.weights[vertex as usize].iter();
        for (sum, weight) in sum.iter_mut().zip(weights) {
            *sum += share * weight;
        }
    }
    sum
}

/// Rejects surfaces without arms and legs, and rigs that do not have the proportions of a person
pub(super) fn check_person(avatar: &Avatar) -> Result<(), LoadAvatarError> {
    let stature_mm = avatar.stature_mm();
    let heads = &avatar.bone_heads;
    let share = |from: Bone, to: Bone| heads[from].distance(heads[to]) / stature_mm;
    let height = |bone: Bone| heads[bone].y / stature_mm;
    let arm = |upper: Bone, lower: Bone, hand: Bone| share(upper, lower) + share(lower, hand);
    use Bone::*;
    // Adults and children from six years on are inside by a fifth; characters with large heads are not.
    let proportions = [
        ("height of the hip joints", height(LeftThigh), 0.40, 0.62),
        ("height of the neck", height(Head), 0.75, 0.95),
        (
            "left arm",
            arm(LeftUpperArm, LeftForearm, LeftHand),
            0.22,
            0.42,
        ),
        (
            "right arm",
            arm(RightUpperArm, RightForearm, RightHand),
            0.22,
            0.42,
        ),
        ("left leg", arm(LeftThigh, LeftShin, LeftFoot), 0.34, 0.58),
        (
            "right leg",
            arm(RightThigh, RightShin, RightFoot),
            0.34,
            0.58,
        ),
        (
            "width of the shoulders",
            share(LeftUpperArm, RightUpperArm),
            0.12,
            0.32,
        ),
    ];
    for (part, share, lowest, highest) in proportions {
        if !(lowest..=highest).contains(&share) {
            return Err(LoadAvatarError::Proportions {
                part,
                percent: 100.0 * share,
                lowest_percent: 100.0 * lowest,
                highest_percent: 100.0 * highest,
            });
        }
    }
    check_limbs(&avatar.mesh, heads, stature_mm)
}

/// Rejects surfaces that do not surround the bones of arms and legs closely
fn check_limbs(
    mesh: &TriMesh,
    heads: &PerBone<DVec3>,
    stature_mm: f64,
) -> Result<(), LoadAvatarError> {
    let winding = WindingNumbers::new(mesh);
    let nearest = NearestSurface::new(mesh);
    let right = LIMBS.map(|(bone, end)| (bone.mirrored(), end.mirrored()));
    for (bone, end) in LIMBS.into_iter().chain(right) {
        let middle = (heads[bone] + heads[end]) / 2.0;
        let radius = nearest
            .nearest(middle)
            .map_or(f64::INFINITY, |found| found.distance);
        if winding.at(middle) < LEVEL || radius > MAX_LIMB_RADIUS * stature_mm {
            return Err(LoadAvatarError::MissingLimb { bone });
        }
    }
    Ok(())
}
