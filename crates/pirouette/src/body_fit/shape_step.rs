//! The surface for given poses of all views: one sparse linear least squares problem.

use glam::{DMat3, DVec3};
use pirouette_geom::parallel::prelude::*;
use pirouette_geom::sparse::{BlockSolver, Place};

use super::matches::{Match, Outline};
use super::surface::Surface;
use super::{Body, BodyFitOptions, BodyFitView};
use pirouette_body::{Pose, PosedBones, Projector, pose_bones};

/// Tikhonov weight of a displacement, per squared mm: keeps unobserved vertices at rest
const SMALLNESS: f64 = 1e-4;

/// Weight of the difference between a displacement and that of the mirrored vertex
const SYMMETRY: f64 = 0.3;

/// Height up to which vertices are soles that stand on the floor, in mm
const SOLE_MM: f64 = 5.0;

/// Total weight of all soles, in points of weight 1 per squared mm
const SOLE_WEIGHT: f64 = 60.0;

/// Vertices at the top of the head that are constrained to the stature
const CROWN_COUNT: usize = 4;

/// The system of the shape step: analyzed once per surface
#[derive(Debug)]
pub(super) struct ShapeSolver<'a> {
    surface: &'a Surface,
    system: BlockSolver,
    /// Smoothness at weight 1, as places and scalar values
    bending: Vec<(Place, f64)>,
    /// Pairs of mirrored vertices, lower first
    pairs: Vec<[u32; 2]>,
    anchors: Vec<Anchor>,
}

/// A vertex with known height
#[derive(Debug, Clone, Copy)]
struct Anchor {
    vertex: u32,
    height_mm: f64,
    weight: f64,
}

/// One residual of the shape step, linear in the displacement of one vertex
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    vertex: u32,
    /// Derivative by the displacement in the reference pose, nominal px per mm, weighted
    gradient: DVec3,
    /// Residual, weighted
    residual: f64,
    /// Residual, in nominal px
    off: f64,
    /// Weight of the match
    share: f64,
}

impl<'a> ShapeSolver<'a> {
    /// Analyzes the system; `None` when memory runs out
    ///
    /// `stature_mm` constrains the crown, if known.
    pub(super) fn new(
        surface: &'a Surface,
        body: &Body,
        stature_mm: Option<f64>,
        options: &BodyFitOptions,
    ) -> Option<Self> {
        let count = surface.coarse_count();
        // L is the identity minus the mean of the neighbors; the energy is |S L d|².
        let mut entries: Vec<([u32; 2], f64)> = Vec::new();
        for (v, around) in surface.neighbors.iter().enumerate() {
            let stiffness = surface.stiffness[v].powi(2) / surface.density();
            let share = -1.0 / around.len().max(1) as f64;
            let row: Vec<(u32, f64)> = std::iter::once((v as u32, 1.0))
                .chain(around.iter().map(|&n| (n, share)))
                .collect();
            for &(a, x) in &row {
                for &(b, y) in row.iter().filter(|(b, _)| *b >= a) {
                    entries.push(([a, b], stiffness * x * y));
                }
            }
        }
        entries.sort_unstable_by_key(|(pair, _)| *pair);
        let pairs: Vec<[u32; 2]> = surface
            .mirror
            .iter()
            .enumerate()
            .filter_map(|(v, image)| image.map(|image| [v as u32, image]))
            .filter(|[v, image]| v <= image)
            .collect();
        let mut pattern: Vec<[u32; 2]> = entries.iter().map(|(pair, _)| *pair).collect();
        pattern.extend(&pairs);
        let system = BlockSolver::new(count, &pattern)?;
        let bending = entries
            .chunk_by(|a, b| a.0 == b.0)
            .map(|group| {
                let [a, b] = group[0].0;
                let place = system.place(a, b).expect("the pattern has all entries");
                (place, group.iter().map(|(_, value)| value).sum())
            })
            .collect();
        Some(Self {
            surface,
            system,
            bending,
            pairs,
            anchors: if options.anchors {
                anchors(&body.rest, stature_mm)
            } else {
                Vec::new()
            },
        })
    }

    /// Solves for the displacements that best explain all residuals
    ///
    /// Returns the root mean square residual of the previous surface in nominal px, with residuals clamped to the
    /// round's robust width; `None` when the equations cannot be solved.
    pub(super) fn step(
        &mut self,
        body: &mut Body,
        rows: &[Vec<Row>],
        round: &super::Round,
        options: &BodyFitOptions,
    ) -> Option<f64> {
        let surface = self.surface;
        let density = surface.density();
        self.system.clear();
        let mut right = vec![DVec3::ZERO; surface.coarse_count()];
        for row in rows.iter().flatten() {
            // Linear about the current displacements.
            let v = row.vertex as usize;
            let now = body.positions[v] - body.rest[v];
            let target = row.gradient.dot(now) - row.residual;
            self.add_row(row.vertex, row.gradient, target, &mut right);
        }
        for anchor in &self.anchors.clone() {
            let rest = body.rest[anchor.vertex as usize].y;
            let gradient = DVec3::Y * anchor.weight.sqrt();
            let target = (anchor.height_mm - rest) * anchor.weight.sqrt();
            self.add_row(anchor.vertex, gradient, target, &mut right);
        }
        for &(place, value) in &self.bending {
            let block = DMat3::from_diagonal(DVec3::splat(round.smoothness * value));
            self.system.add_at(place, block);
        }
        for v in 0..surface.coarse_count() as u32 {
            let block = DMat3::from_diagonal(DVec3::splat(SMALLNESS * density));
            self.add_block(v, v, block);
        }
        if options.symmetry {
            let flip = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
            // Both vertices of a pair get the same difference.
            let weight = 2.0 * SYMMETRY * density;
            for &[v, image] in &self.pairs.clone() {
                if v == image {
                    let across = DVec3::new(2.0 * weight, 0.0, 0.0);
                    self.add_block(v, v, DMat3::from_diagonal(across));
                } else {
                    let own = DMat3::IDENTITY * weight;
                    self.add_block(v, v, own);
                    self.add_block(image, image, own);
                    self.add_block(v, image, flip * -weight);
                }
            }
        }
        if !self.system.solve(&mut right) {
            return None;
        }
        body.displace(&surface.coarse.blends, &right);
        Some(residual(rows, round))
    }

    fn add_block(&mut self, a: u32, b: u32, block: DMat3) {
        let place = self.system.place(a, b).expect("the pattern has all pairs");
        self.system.add_at(place, block);
    }

    /// Adds the square of `gradient . displacement - target` of a vertex
    fn add_row(&mut self, vertex: u32, gradient: DVec3, target: f64, right: &mut [DVec3]) {
        let blend = &self.surface.coarse.blends[vertex as usize];
        let outer = DMat3::from_cols(
            gradient * gradient.x,
            gradient * gradient.y,
            gradient * gradient.z,
        );
        for i in 0..3 {
            let (a, x) = (blend.vertices[i], blend.weights[i]);
            if x <= 0.0 {
                continue;
            }
            right[a as usize] += gradient * (target * x);
            for j in 0..=i {
                let (b, y) = (blend.vertices[j], blend.weights[j]);
                if y > 0.0 {
                    self.add_block(a, b, outer * (x * y));
                }
            }
        }
    }
}

fn anchors(rest: &[DVec3], stature_mm: Option<f64>) -> Vec<Anchor> {
    let lowest = rest.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
    let mut anchors: Vec<Anchor> = rest
        .iter()
        .enumerate()
        .filter(|(_, p)| p.y < lowest + SOLE_MM)
        .map(|(v, _)| Anchor {
            vertex: v as u32,
            height_mm: 0.0,
            weight: 0.0,
        })
        .collect();
    let weight = SOLE_WEIGHT / anchors.len().max(1) as f64;
    for anchor in &mut anchors {
        anchor.weight = weight;
    }
    if let Some(stature_mm) = stature_mm {
        let mut order: Vec<u32> = (0..rest.len() as u32).collect();
        let height = |v: u32| rest[v as usize].y;
        order.sort_by(|&a, &b| height(b).total_cmp(&height(a)));
        let top = order.first().map_or(0.0, |&v| height(v));
        anchors.extend(order.iter().take(CROWN_COUNT).map(|&vertex| Anchor {
            vertex,
            height_mm: stature_mm + height(vertex) - top,
            weight: 1.0,
        }));
    }
    anchors
}

impl Row {
    /// Creates the row of a signed distance of a vertex from its target, in nominal px
    ///
    /// `gradient` by the displacement in the reference pose; the weight falls with the distance.
    pub(super) fn new(vertex: u32, gradient: DVec3, off: f64, share: f64, robust: f64) -> Self {
        let weight = share.sqrt() / (1.0 + (off / robust).powi(2));
        Self {
            vertex,
            gradient: gradient * weight,
            residual: off * weight,
            off,
            share,
        }
    }
}

/// Computes the residuals of all views
pub(super) fn rows(
    body: &Body,
    views: &[BodyFitView],
    (outlines, matches): (&[Outline], &[Vec<Match>]),
    poses: &[Pose],
    round: &super::Round,
) -> Vec<Vec<Row>> {
    views
        .par_iter()
        .zip(outlines)
        .zip(matches)
        .zip(poses)
        .map(|(((view, outline), matches), pose)| {
            let posed = pose_bones(&body.bone_heads, pose, view.turn);
            let camera = view.camera.projector();
            let row = |m| row(body, &posed, &camera, outline, m, round);
            matches.iter().map(row).collect()
        })
        .collect()
}

fn row(
    body: &Body,
    posed: &PosedBones,
    camera: &Projector,
    outline: &Outline,
    m: &Match,
    round: &super::Round,
) -> Row {
    let v = m.vertex as usize;
    let blend = posed.blend(&body.weights[v]);
    let point = blend.transform_point3(body.positions[v]);
    let (residual, in_room) = m.residual(camera, point, outline);
    let gradient = blend.matrix3.transpose() * in_room;
    Row::new(m.vertex, gradient, residual, m.weight, round.robust)
}

/// Returns the root mean square of all residuals, clamped to the robust width, in nominal px
pub(super) fn residual(rows: &[Vec<Row>], round: &super::Round) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for row in rows.iter().flatten() {
        sum += row.share * row.off.abs().min(round.robust).powi(2);
        weight += row.share;
    }
    (sum / f64::max(weight, 1.0)).sqrt()
}
