//! Deformation of a silhouette: its joints move to targets, the remainder follows as rigidly as possible.
//!
//! The contour is simplified and meshed, but the full contour is transferred and filled at the end: a silhouette whose
//! joints do not move is reproduced to a small fraction of a pixel. Of several separate parts only the largest is kept,
//! with its holes.
//!
//! # Source
//! Handles and targets: Zwettler et al. 2021. The as-rigid-as-possible deformation itself is `pirouette_geom::arap`.

use glam::DVec2;
use pirouette_geom::arap::{ArapError, ArapOptions, ArapSolver, Deformation};
use pirouette_geom::contour::{Contour, trace_borders, trace_windowed, widen_border};
use pirouette_geom::coverage::fill_edges;
use pirouette_geom::planar_mesh::{
    PlanarMesh, TriangulateError, TriangulateOptions, simplify_apart, triangulate,
};
use pirouette_geom::{Grid, Mask, Windowed};

use super::JointPositions;
use pirouette_body::{Bone, Joint};

/// Number of handles along each bone: both joints and evenly spaced points between them
///
/// Zwettler et al. 2021 put 5 interim points on each limb; 2 or 9 give equal results.
const HANDLES_PER_BONE: usize = 7;

/// Minimum distance of handles from the contour, in px
///
/// On the contour itself, a handle a pixel away from the true joint would dent the outline.
const HANDLE_CLEARANCE_PX: f64 = 1.5;

/// Normals of the contour are computed over this many of its points to either side
const NORMAL_REACH: usize = 4;

/// A line of handles from joint to joint
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HandleBone {
    /// Joint at its start
    pub from: Joint,
    /// Joint at its end
    pub to: Joint,
    /// The bone that must be visible for the line to be used, where only visible ones are
    pub seen_as: Bone,
}

/// Separate handles of the face: they turn the head, of which the line to the nose captures only the length in profile
const FACE: [Joint; 4] = [
    Joint::LeftEye,
    Joint::RightEye,
    Joint::LeftEar,
    Joint::RightEar,
];

/// All lines of handles
pub const HANDLE_BONES: [HandleBone; 16] = {
    const fn line(from: Joint, to: Joint, seen_as: Bone) -> HandleBone {
        HandleBone { from, to, seen_as }
    }
    use Joint::*;
    [
        line(Neck, MidHip, Bone::LowerSpine),
        line(Neck, RightShoulder, Bone::RightClavicle),
        line(Neck, LeftShoulder, Bone::LeftClavicle),
        line(MidHip, RightHip, Bone::Root),
        line(MidHip, LeftHip, Bone::Root),
        line(Neck, Nose, Bone::Head),
        line(RightShoulder, RightElbow, Bone::RightUpperArm),
        line(RightElbow, RightWrist, Bone::RightForearm),
        line(LeftShoulder, LeftElbow, Bone::LeftUpperArm),
        line(LeftElbow, LeftWrist, Bone::LeftForearm),
        line(RightHip, RightKnee, Bone::RightThigh),
        line(RightKnee, RightAnkle, Bone::RightShin),
        line(LeftHip, LeftKnee, Bone::LeftThigh),
        line(LeftKnee, LeftAnkle, Bone::LeftShin),
        line(RightAnkle, RightBigToe, Bone::RightFoot),
        line(LeftAnkle, LeftBigToe, Bone::LeftFoot),
    ]
};

/// Source of a silhouette's contour
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContourSource {
    /// The half level of the soft silhouette: sub-pixel accurate, without bias
    #[default]
    Outline,
    /// The border pixels of the mask, as published, moved outward by half a pixel to the edges of their squares
    BorderPixels,
}

/// Resolution of meshing and deformation
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeformOptions {
    /// Source of the meshed contour
    pub contour: ContourSource,
    /// Tolerance of the contour's simplification before meshing, in px
    ///
    /// Smaller values produce more triangles; the filled outline is the full contour in any case.
    pub tolerance_px: f64,
    /// Approximate upper bound on triangle areas, in square px
    pub max_triangle_area: f64,
    /// Rounds and tolerance of the deformation
    pub arap: ArapOptions,
}

impl Default for DeformOptions {
    /// As published: tolerance 1; 30 rounds
    fn default() -> Self {
        Self {
            contour: ContourSource::Outline,
            tolerance_px: 1.0,
            max_triangle_area: 250.0,
            arap: ArapOptions::default(),
        }
    }
}

/// Why a silhouette cannot be deformed
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DeformError {
    /// The silhouette has no pixels inside
    #[error("the silhouette is empty")]
    Empty,
    /// The contour could not be meshed
    #[error("the contour of the silhouette cannot be meshed")]
    Mesh(#[source] TriangulateError),
    /// The deformation of the mesh could not be prepared
    #[error("the mesh of the silhouette cannot be deformed")]
    Arap(#[source] ArapError),
}

/// Handles of a silhouette: their positions and targets, in px
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Handles {
    /// Positions in the silhouette
    pub sources: Vec<DVec2>,
    /// Targets, one per source
    pub targets: Vec<DVec2>,
}

/// Elbow, wrist and bone of the arms, whose hands turn with the forearm
const HANDS: [(Joint, Joint, Bone); 2] = [
    (Joint::RightElbow, Joint::RightWrist, Bone::RightForearm),
    (Joint::LeftElbow, Joint::LeftWrist, Bone::LeftForearm),
];

/// Distance of a hand's handle beyond the wrist, in lengths of the forearm, the longer one of before and after
///
/// Without it, hands rotate by a few degrees independently where a forearm changes its length. Much farther, it lies
/// outside a bent hand, where it is not used.
const HAND_HANDLE: f64 = 0.3;

/// Distributes handles along all bones whose joints are known before and after, into the hands, and over the face
///
/// `used` selects the bones. The direction of a hand is unknown; it rotates with the forearm.
pub fn handles(from: &JointPositions, to: &JointPositions, used: impl Fn(Bone) -> bool) -> Handles {
    let mut handles = Handles::default();
    for bone in HANDLE_BONES.into_iter().filter(|line| used(line.seen_as)) {
        let ends = |joints: &JointPositions| {
            let (a, b) = (joints[bone.from]?, joints[bone.to]?);
            (a.is_finite() && b.is_finite()).then_some((a, b))
        };
        let (Some((source_a, source_b)), Some((target_a, target_b))) = (ends(from), ends(to))
        else {
            continue;
        };
        let steps = HANDLES_PER_BONE - 1;
        for i in 0..=steps {
            let t = i as f64 / steps as f64;
            handles.sources.push(source_a.lerp(source_b, t));
            handles.targets.push(target_a.lerp(target_b, t));
        }
    }
    for (elbow, wrist, _) in HANDS.into_iter().filter(|hand| used(hand.2)) {
        let ends = |joints: &JointPositions| {
            let (elbow, wrist) = (joints[elbow]?, joints[wrist]?);
            let forearm = wrist - elbow;
            Some((wrist, forearm.length(), forearm.try_normalize()?))
        };
        if let (Some((source, one, from)), Some((target, other, to))) = (ends(from), ends(to))
            && (source + target).is_finite()
        {
            let reach = HAND_HANDLE * one.max(other);
            handles.sources.push(source + reach * from);
            handles.targets.push(target + reach * to);
        }
    }
    for joint in FACE.into_iter().filter(|_| used(Bone::Head)) {
        if let (Some(source), Some(target)) = (from[joint], to[joint])
            && source.is_finite()
            && target.is_finite()
        {
            handles.sources.push(source);
            handles.targets.push(target);
        }
    }
    handles
}

/// Traces the contour of the largest part of a silhouette, and those of its holes
///
/// # Source
/// Border following: Suzuki & Abe 1985, for [`ContourSource::BorderPixels`].
pub fn trace_silhouette(mask: &Mask, soft: &Windowed<f32>, source: ContourSource) -> Vec<Contour> {
    match source {
        ContourSource::Outline => largest_with_holes(trace_windowed(soft, 0.5)),
        ContourSource::BorderPixels => {
            let borders = trace_borders(mask);
            let largest = borders
                .iter()
                .enumerate()
                .filter(|(_, border)| !border.contour.hole)
                .max_by(|(_, a), (_, b)| {
                    let area = |c: &Contour| c.signed_area();
                    area(&a.contour).total_cmp(&area(&b.contour))
                })
                .map(|(i, _)| i);
            borders
                .iter()
                .enumerate()
                .filter(|(i, border)| {
                    Some(*i) == largest || (border.contour.hole && border.parent == largest)
                })
                .map(|(_, border)| widen_border(&border.contour))
                .collect()
        }
    }
}

/// Returns the outer loop of the largest area and the holes directly in it
fn largest_with_holes(mut loops: Vec<Contour>) -> Vec<Contour> {
    loops.sort_by(|a, b| b.signed_area().total_cmp(&a.signed_area()));
    let (outer, holes): (Vec<Contour>, Vec<Contour>) = loops.into_iter().partition(|c| !c.hole);
    let mut outer = outer.into_iter();
    let Some(largest) = outer.next() else {
        return Vec::new();
    };
    let contains =
        |loop_: &Contour, other: &Contour| other.points.first().is_some_and(|&p| loop_.contains(p));
    // parts within holes of the largest have their own holes
    let islands: Vec<Contour> = outer.filter(|part| contains(&largest, part)).collect();
    let mut kept: Vec<Contour> = holes
        .into_iter()
        .filter(|hole| contains(&largest, hole))
        .filter(|hole| !islands.iter().any(|island| contains(island, hole)))
        .collect();
    kept.insert(0, largest);
    kept
}

/// A silhouette prepared for deformation by a fixed set of handles
#[derive(Debug)]
pub struct DeformableSilhouette {
    mesh: PlanarMesh,
    solver: ArapSolver,
    /// For each given handle its index among the constrained vertices; `None` for those outside the silhouette
    places: Vec<Option<u32>>,
    constrained: Vec<u32>,
    sources: Vec<DVec2>,
    contours: Vec<AttachedContour>,
    arap: ArapOptions,
}

/// A full contour attached to the mesh
#[derive(Debug)]
struct AttachedContour {
    hole: bool,
    points: Vec<Attachment>,
}

/// Attachment of a contour point to the mesh
#[derive(Debug, Clone, Copy)]
enum Attachment {
    /// To the segment between two vertices: share of the way, and perpendicular offset in px
    Segment {
        from: u32,
        to: u32,
        along: f64,
        across: f64,
    },
    /// To one vertex, at this offset in the rest mesh
    Vertex { vertex: u32, offset: DVec2 },
}

/// A deformed silhouette
#[derive(Debug, Clone)]
pub struct DeformedSilhouette {
    /// The full contours, in px; loops may overlap themselves where limbs cross
    pub contours: Vec<Contour>,
    /// Outcome of the deformation of the mesh
    pub deformation: Deformation,
}

impl DeformableSilhouette {
    /// Meshes the contours of a silhouette with the handles inside and prepares the deformation
    ///
    /// Handles outside, on the contour, or within 1.5 px of it are ignored. Handles that (nearly) coincide share a
    /// vertex, which moves by the mean of their displacements.
    ///
    /// # Errors
    /// When the contours enclose no area.
    pub fn new(
        contours: &[Contour],
        sources: &[DVec2],
        options: &DeformOptions,
    ) -> Result<Self, DeformError> {
        let meshed = Meshed::new(contours, sources, options)?;
        let mut constrained: Vec<u32> = meshed.interior.iter().flatten().copied().collect();
        constrained.sort_unstable();
        constrained.dedup();
        let places = meshed
            .interior
            .iter()
            .map(|v| Some(constrained.binary_search(&(*v)?).ok()? as u32))
            .collect();
        meshed.prepare(constrained, places, sources.to_vec(), options)
    }

    /// Meshes the contours of a silhouette and uses points of the contours themselves as handles
    ///
    /// `target` returns the target of a point with an outward normal, both in px; points for which it returns none
    /// follow the others. Also returns the targets, for [`DeformableSilhouette::deform`].
    ///
    /// # Errors
    /// When the contours enclose no area.
    pub fn by_outline(
        contours: &[Contour],
        target: impl Fn(DVec2, DVec2) -> Option<DVec2>,
        options: &DeformOptions,
    ) -> Result<(Self, Vec<DVec2>), DeformError> {
        let meshed = Meshed::new(contours, &[], options)?;
        let mut handles: Vec<(u32, DVec2, DVec2)> = Vec::new();
        for ((contour, kept_indices), vertices) in contours
            .iter()
            .zip(&meshed.kept_indices)
            .zip(&meshed.on_contour)
        {
            let count = contour.points.len();
            for (&at, vertex) in kept_indices.iter().zip(vertices) {
                let reach = NORMAL_REACH.min(count / 2);
                let along = contour.points[(at + reach) % count]
                    - contour.points[(at + count - reach) % count];
                // Clockwise on screen around the silhouette, so that outward is a quarter turn to the left.
                let out = DVec2::new(along.y, -along.x).try_normalize();
                if let (Some(vertex), Some(out)) = (*vertex, out)
                    && let Some(target) = target(contour.points[at], out)
                    && target.is_finite()
                {
                    handles.push((vertex, meshed.mesh.positions[vertex as usize], target));
                }
            }
        }
        handles.sort_by_key(|handle| handle.0);
        handles.dedup_by_key(|handle| handle.0);
        let constrained: Vec<u32> = handles.iter().map(|handle| handle.0).collect();
        let places = (0..handles.len() as u32).map(Some).collect();
        let sources = handles.iter().map(|handle| handle.1).collect();
        let targets = handles.iter().map(|handle| handle.2).collect();
        Ok((
            meshed.prepare(constrained, places, sources, options)?,
            targets,
        ))
    }

    /// Returns the rest mesh
    pub fn mesh(&self) -> &PlanarMesh {
        &self.mesh
    }

    /// Returns the number of handles inside the silhouette
    pub fn handle_count(&self) -> usize {
        self.places.iter().flatten().count()
    }

    /// Moves the handles to `targets`, one per given source in px; without handles inside, the silhouette is unchanged
    ///
    /// # Panics
    /// When the number of targets differs from the number of sources.
    pub fn deform(&self, targets: &[DVec2]) -> DeformedSilhouette {
        assert_eq!(targets.len(), self.sources.len(), "one target per source");
        let mut shifts = vec![(DVec2::ZERO, 0.0); self.constrained.len()];
        for ((place, source), target) in self.places.iter().zip(&self.sources).zip(targets) {
            if let Some(place) = place {
                let (sum, count) = &mut shifts[*place as usize];
                *sum += *target - *source;
                *count += 1.0;
            }
        }
        let targets: Vec<DVec2> = self
            .constrained
            .iter()
            .zip(shifts)
            .map(|(&v, (sum, count))| self.mesh.positions[v as usize] + sum / f64::max(count, 1.0))
            .collect();
        let deformation = self.solver.deform(&targets, &self.arap);
        let contours = self
            .contours
            .iter()
            .map(|contour| Contour {
                points: contour
                    .points
                    .iter()
                    .map(|point| point.carried(&deformation))
                    .collect(),
                hole: contour.hole,
            })
            .collect();
        DeformedSilhouette {
            contours,
            deformation,
        }
    }
}

/// Contours with their mesh
struct Meshed<'a> {
    contours: &'a [Contour],
    /// Indices of the points of each contour that the simplified contour keeps
    kept_indices: Vec<Vec<usize>>,
    mesh: PlanarMesh,
    interior: Vec<Option<u32>>,
    on_contour: Vec<Vec<Option<u32>>>,
}

impl<'a> Meshed<'a> {
    fn new(
        contours: &'a [Contour],
        interior: &[DVec2],
        options: &DeformOptions,
    ) -> Result<Self, DeformError> {
        if contours.is_empty() {
            return Err(DeformError::Empty);
        }
        let meshing = TriangulateOptions {
            max_area: Some(options.max_triangle_area),
            clearance: HANDLE_CLEARANCE_PX,
        };
        let longest_px = meshing.spacing_px().unwrap_or(f64::INFINITY);
        let kept_indices = simplify_apart(contours, options.tolerance_px, longest_px);
        let simplified: Vec<Contour> = contours
            .iter()
            .zip(&kept_indices)
            .map(|(contour, kept_indices)| Contour {
                points: kept_indices.iter().map(|&i| contour.points[i]).collect(),
                hole: contour.hole,
            })
            .collect();
        let made = triangulate(&simplified, interior, &meshing).map_err(DeformError::Mesh)?;
        Ok(Self {
            contours,
            kept_indices,
            mesh: made.mesh,
            interior: made.interior_vertices,
            on_contour: made.contour_vertices,
        })
    }

    fn prepare(
        self,
        constrained: Vec<u32>,
        places: Vec<Option<u32>>,
        sources: Vec<DVec2>,
        options: &DeformOptions,
    ) -> Result<DeformableSilhouette, DeformError> {
        let solver = ArapSolver::new(&self.mesh, &constrained).map_err(DeformError::Arap)?;
        let contours = self
            .contours
            .iter()
            .zip(&self.kept_indices)
            .zip(&self.on_contour)
            .map(|((contour, kept_indices), vertices)| {
                attach(contour, kept_indices, vertices, &self.mesh)
            })
            .collect();
        Ok(DeformableSilhouette {
            mesh: self.mesh,
            solver,
            places,
            constrained,
            sources,
            contours,
            arap: options.arap,
        })
    }
}

impl Attachment {
    fn carried(&self, deformation: &Deformation) -> DVec2 {
        let at = |v: u32| deformation.positions[v as usize];
        match *self {
            Attachment::Segment {
                from,
                to,
                along,
                across,
            } => {
                let (a, b) = (at(from), at(to));
                let normal = (b - a).perp().try_normalize().unwrap_or(DVec2::ZERO);
                a + along * (b - a) + across * normal
            }
            Attachment::Vertex { vertex, offset } => {
                at(vertex) + deformation.rotations[vertex as usize].rotate(offset)
            }
        }
    }
}

/// Attaches each point of a contour to the corresponding segment of the simplified contour
fn attach(
    contour: &Contour,
    kept_indices: &[usize],
    vertices: &[Option<u32>],
    mesh: &PlanarMesh,
) -> AttachedContour {
    let count = contour.points.len();
    let mut points = Vec::with_capacity(count);
    for k in 0..kept_indices.len() {
        let next = (k + 1) % kept_indices.len();
        // a contour with a single kept point wraps around once
        let steps = match (kept_indices[next] + count - kept_indices[k]) % count {
            0 => count,
            steps => steps,
        };
        for step in 0..steps {
            let p = contour.points[(kept_indices[k] + step) % count];
            points.push(attach_point(p, vertices[k], vertices[next], mesh));
        }
    }
    AttachedContour {
        hole: contour.hole,
        points,
    }
}

fn attach_point(p: DVec2, from: Option<u32>, to: Option<u32>, mesh: &PlanarMesh) -> Attachment {
    let at = |v: u32| mesh.positions[v as usize];
    if let (Some(from), Some(to)) = (from, to) {
        let (a, b) = (at(from), at(to));
        if let Some(direction) = (b - a).try_normalize() {
            return Attachment::Segment {
                from,
                to,
                along: (p - a).dot(direction) / a.distance(b),
                across: direction.perp_dot(p - a),
            };
        }
    }
    // on bridges, which have no triangles: use the nearest vertex
    let nearest = (0..mesh.positions.len() as u32).min_by(|&a, &b| {
        let distance = |v: u32| at(v).distance_squared(p);
        distance(a).total_cmp(&distance(b))
    });
    let vertex = nearest.unwrap_or(0);
    Attachment::Vertex {
        vertex,
        offset: p - at(vertex),
    }
}

/// Fills contours: the coverage of each pixel, from 0 to 1
///
/// Where loops overlap, as limbs over the trunk, the overlap counts as inside.
pub fn fill_contours(width: usize, height: usize, contours: &[Contour]) -> Grid<f32> {
    let edges: Vec<[DVec2; 2]> = contours.iter().flat_map(Contour::edges).collect();
    fill_edges(width, height, &edges)
}

#[cfg(test)]
pub(in crate::normalize) mod tests;
