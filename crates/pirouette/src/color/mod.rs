//! Vertex colors: combines the photos that best show each part of the surface.
//!
//! Each view provides for a vertex the mean color of the pixels around it, if the vertex is not occluded. Views that
//! see the surface head-on have the most weight; near the silhouette's border, and near the border of another part of
//! the body, the weight of a view falls off, so that neither background nor the other part bleeds in, and no seam
//! appears where views change. Vertices that no view sees are filled smoothly from their neighborhood.
//!
//! The lighting of the room is not removed from the colors. Details finer than the mesh are lost.
//!
//! # Source
//! Bernardini, Martin and Rushmeier, "High-Quality Texture Reconstruction from Multiple Scans", TVCG 7(4), 2001, for
//! weights by viewing angle and distance to borders.

use glam::{DVec2, DVec3};
use pirouette_geom::parallel::prelude::*;
use pirouette_geom::{Grid, Mask, TriMesh};

use crate::scan::Photo;
use pirouette_body::render::SilhouetteMesh;
use pirouette_body::{Avatar, Camera, NOMINAL_STATURE_PX, Pose, Projector, TurnAngle, render};

/// A view to take colors from; photo and mask have the size given by the camera
#[derive(Debug, Clone, Copy)]
pub struct ColorView<'a> {
    /// The photo
    pub photo: &'a Photo,
    /// Mask of the person in the photo
    pub mask: &'a Mask,
    /// The camera of the view
    pub camera: Camera,
    /// Turn angle of the person
    pub turn: TurnAngle,
    /// Pose of the person
    pub pose: Pose,
}

/// How colors are combined
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorOptions {
    /// Exponent of the cosine between surface normal and view direction in the weight of a view; larger values use
    /// fewer views
    pub sharpness: f64,
    /// Falloff of a view's weight towards the border of the silhouette
    pub outline: Fade,
    /// Falloff of a view's weight towards the border of another part of the body, in front of or behind this one
    pub overlap: Fade,
    /// Number of smoothing rounds for filled vertices
    pub fill_rounds: usize,
}

/// Distances from a border over which the weight of a view increases, in nominal px
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fade {
    /// The weight is zero below this
    pub none_px: f64,
    /// The weight is full above this
    pub full_px: f64,
}

impl Fade {
    fn weight(&self, away_px: f64) -> f64 {
        smooth_step((away_px - self.none_px) / (self.full_px - self.none_px).max(1e-9))
    }

    /// Returns the same in px of a photo; `limit_px` at most
    fn scaled(&self, unit_px: f64, limit_px: f64) -> Self {
        Self {
            none_px: (self.none_px * unit_px).min(limit_px),
            full_px: (self.full_px * unit_px).min(limit_px),
        }
    }
}

impl Default for ColorOptions {
    fn default() -> Self {
        Self {
            sharpness: 6.0,
            outline: Fade {
                none_px: 1.5,
                full_px: 6.0,
            },
            // No outline shows the position of an arm in front of the trunk, so its error may be larger than at the
            // outline. If too small, hands take the color of the hip behind them, and leave theirs on it.
            overlap: Fade {
                none_px: 5.0,
                full_px: 14.0,
            },
            fill_rounds: 60,
        }
    }
}

/// Colors of a surface
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SurfaceColors {
    /// Color of each vertex as stored in files (sRGB), same order as the mesh's positions
    pub srgb: Vec<[u8; 3]>,
    /// Number of views that see each vertex, not at a grazing angle and not directly at a border
    pub view_counts: Vec<u16>,
}

impl SurfaceColors {
    /// Returns the colors in linear light, 0 to 1
    pub fn to_linear(&self) -> Vec<[f32; 3]> {
        let levels = linear_levels();
        let linear = |color: &[u8; 3]| color.map(|v| levels[v as usize]);
        self.srgb.iter().map(linear).collect()
    }
}

/// Surfaces seen at a smaller cosine than this provide no color
///
/// At 78 degrees one pixel spans five of the surface, and the surface lies within a few pixels of its border.
const MIN_COSINE: f64 = 0.2;

/// Depth difference of two separate surfaces, in mm, at the same position and per mm of lateral distance
///
/// A surface seen at [`MIN_COSINE`] has a slope of five; at a slope of three it has almost no weight.
const APART_MM: f64 = 15.0;
const APART_SLOPE: f64 = 3.0;

/// Radius of the disc whose mean color a vertex takes, relative to the distance of its neighbors
///
/// Much smaller, patterns finer than the mesh turn into specks; larger, faces blur.
const DISC_SHARE: f64 = 0.5;

/// Upper bound of the disc radius, in px, however coarse the mesh
const MAX_DISC_PX: f64 = 12.0;

/// Number of rounds in which the weight of a view fades towards vertices that it does not see
const FADE_ROUNDS: usize = 3;

/// Sum of weights from which the consensus color of the views is used fully; below, neighbors contribute, too
const SURE_WEIGHT: f64 = 0.1;

/// Distance of a color from the others' mean, in square roots of linear light, at which it loses half its weight
const ODD_COLOR: f64 = 0.15;

/// Colors the vertices of a fitted body from the photos; `None` when no view sees any
///
/// Views whose photo or mask differs from the camera in size, and non-finite parts of a pose, see no vertex.
///
/// # Panics
/// When a triangle refers to a vertex that does not exist.
pub fn color_surface(
    avatar: &Avatar,
    views: &[ColorView],
    options: &ColorOptions,
) -> Option<SurfaceColors> {
    let mesh = SilhouetteMesh::new(&avatar.mesh.triangles);
    let neighbors = Neighbors::new(mesh.edges(), avatar.mesh.positions.len());
    let surface = Surface {
        avatar,
        spacings_mm: neighbors.spacings(&avatar.mesh.positions),
        stature_mm: avatar.stature_mm(),
        mesh,
        neighbors,
    };
    let view_colors: Vec<Vec<ViewColor>> = views
        .par_iter()
        .map(|view| sample_view(&surface, view, options))
        .collect();
    let of_vertex = |v: usize| {
        let of_views = || {
            view_colors
                .iter()
                .filter_map(|view_colors| view_colors.get(v))
        };
        let seen = of_views().filter(|color| color.seen);
        (consensus(of_views()), seen.count() as u16)
    };
    let vertices = (0..avatar.mesh.positions.len()).into_par_iter();
    let (agreed, view_counts): (Vec<_>, Vec<_>) = vertices.map(of_vertex).unzip();
    let filled = fill(&agreed, &surface.neighbors, options.fill_rounds)?;
    let srgb = |linear: DVec3| {
        let channel = |v: f64| (255.0 * render::srgb_from_linear(v as f32)).round() as u8;
        linear.to_array().map(channel)
    };
    Some(SurfaceColors {
        srgb: filled.into_iter().map(srgb).collect(),
        view_counts,
    })
}

/// The observation of a vertex in one view: a color in linear light, and its weight
#[derive(Debug, Clone, Copy, Default)]
struct ViewColor {
    color: [f32; 3],
    weight: f32,
    seen: bool,
}

/// The body with the data that all views need
struct Surface<'a> {
    avatar: &'a Avatar,
    mesh: SilhouetteMesh,
    neighbors: Neighbors,
    /// Mean distance of each vertex from its neighbors
    spacings_mm: Vec<f64>,
    stature_mm: f64,
}

/// Computes the color that one view provides for each vertex
fn sample_view(surface: &Surface, view: &ColorView, options: &ColorOptions) -> Vec<ViewColor> {
    let avatar = surface.avatar;
    let camera = &view.camera;
    let size = (camera.width_px, camera.height_px);
    let focal_px = camera.focal_px();
    let unit_px = focal_px * surface.stature_mm / camera.distance_mm / NOMINAL_STATURE_PX;
    if (view.photo.width(), view.photo.height()) != size
        || (view.mask.width(), view.mask.height()) != size
        || !(unit_px > 0.0 && unit_px.is_finite())
    {
        return Vec::new();
    }
    let mesh = TriMesh {
        positions: avatar.posed(&view.pose, view.turn).positions,
        triangles: avatar.mesh.triangles.clone(),
    };
    let mut outline = options.outline.scaled(unit_px, MAX_REACH_PX);
    outline.none_px = outline.none_px.max(MIXED_PX);
    outline.full_px = outline.full_px.max(2.0 * MIXED_PX);
    let overlap = options.overlap.scaled(unit_px, MAX_REACH_PX);
    let scene = Scene {
        view,
        projector: camera.projector(),
        focal_px,
        depth_mm: &surface.mesh.depth_map(&mesh.positions, camera),
        levels: &linear_levels(),
        outline,
        overlap,
        around: pixels_around(outline.full_px.max(overlap.full_px)),
    };
    let mut view_colors: Vec<ViewColor> = mesh
        .positions
        .iter()
        .zip(mesh.vertex_normals())
        .zip(&surface.spacings_mm)
        .map(|((&position, normal), &spacing_mm)| {
            let found = scene.vertex_color(position, normal, spacing_mm, options.sharpness);
            found.unwrap_or_default()
        })
        .collect();
    for _ in 0..FADE_ROUNDS {
        let weights: Vec<f32> = view_colors.iter().map(|color| color.weight).collect();
        for (v, color) in view_colors.iter_mut().enumerate() {
            let around = surface.neighbors.of(v);
            let sum: f32 = around.iter().map(|&n| weights[n as usize]).sum();
            color.weight = color.weight.min(sum / around.len().max(1) as f32);
        }
    }
    view_colors
}

/// Pixels this close to the outline, in px, contain some background at any size of the photo
const MIXED_PX: f64 = 1.5;

/// Largest search distance for borders, in px, however large the photo
const MAX_REACH_PX: f64 = 24.0;

/// Borders beyond this distance are searched on every other column and row, in px
const DENSE_PX: f64 = 4.0;

/// Pixels around a center within which borders are searched, with their distance in px, nearest first
fn pixels_around(reach_px: f64) -> Vec<(isize, isize, f64)> {
    let reach = reach_px.ceil() as isize;
    let mut around: Vec<(isize, isize, f64)> = (-reach..=reach)
        .flat_map(|y| (-reach..=reach).map(move |x| (x, y, (x as f64).hypot(y as f64))))
        .filter(|&(x, y, away_px)| {
            away_px <= DENSE_PX || (away_px <= reach_px && x % 2 == 0 && y % 2 == 0)
        })
        .collect();
    around.sort_by(|a, b| a.2.total_cmp(&b.2));
    around
}

/// A photo with the visible part of the body
struct Scene<'a> {
    view: &'a ColorView<'a>,
    projector: Projector,
    focal_px: f64,
    depth_mm: &'a Grid<f32>,
    /// Linear light of each gray level of the photo
    levels: &'a [f32; 256],
    outline: Fade,
    overlap: Fade,
    /// Offsets at which borders are searched, nearest first
    around: Vec<(isize, isize, f64)>,
}

impl Scene<'_> {
    /// Returns the color around a vertex, `None` where it is not visible
    fn vertex_color(
        &self,
        position: DVec3,
        normal: DVec3,
        spacing_mm: f64,
        sharpness: f64,
    ) -> Option<ViewColor> {
        let camera = &self.view.camera;
        let to_camera = (camera.center() - position).try_normalize()?;
        let cosine = normal.dot(to_camera);
        let seen = self.projector.view_from_room(position);
        let (at, depth_mm) = (self.projector.photo_from_view(seen), seen.z);
        // also drops NaN
        if !(cosine > MIN_COSINE && depth_mm > render::MIN_DEPTH_MM && at.is_finite()) {
            return None;
        }
        let px_per_mm = self.focal_px / depth_mm;
        let (outline_px, overlap_px) = self.borders_px(at, depth_mm, px_per_mm);
        let clear = self.outline.weight(outline_px) * self.overlap.weight(overlap_px);
        let facing = (cosine - MIN_COSINE) / (1.0 - MIN_COSINE);
        let weight = clear * facing.powf(sharpness);
        if weight.is_nan() || weight <= 0.0 {
            return None;
        }
        let disc_px = (DISC_SHARE * spacing_mm * px_per_mm).clamp(0.5, MAX_DISC_PX);
        Some(ViewColor {
            color: self.mean_color(at, disc_px.min(overlap_px).min(outline_px - MIXED_PX))?,
            weight: weight as f32,
            seen: true,
        })
    }

    /// Estimates the distances of the outline and of the border of another part, infinite where out of reach
    ///
    /// An occluded vertex is at 0 px from the other part.
    fn borders_px(&self, at: DVec2, depth_mm: f64, px_per_mm: f64) -> (f64, f64) {
        let (column, row) = (at.x.floor() as isize, at.y.floor() as isize);
        let (mut outline_px, mut overlap_px) = (f64::INFINITY, f64::INFINITY);
        for &(x, y, away_px) in &self.around {
            if outline_px.is_infinite() && self.view.mask.get(column + x, row + y) != Some(&true) {
                outline_px = away_px;
            }
            let beside_mm = away_px / px_per_mm;
            if let Some(&there) = self.depth_mm.get(column + x, row + y)
                && there.is_finite()
                && (f64::from(there) - depth_mm).abs() > APART_MM + APART_SLOPE * beside_mm
            {
                overlap_px = away_px;
                break;
            }
        }
        (outline_px, overlap_px)
    }

    /// Returns the mean color of a disc
    fn mean_color(&self, at: DVec2, radius_px: f64) -> Option<[f32; 3]> {
        let (column, row) = (at.x.floor() as isize, at.y.floor() as isize);
        let reach = radius_px.ceil() as isize;
        let (mut sum, mut total) = ([0f32; 3], 0f32);
        for y in row - reach..=row + reach {
            for x in column - reach..=column + reach {
                let away = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - at;
                // approximate part of the pixel that the disc covers
                let weight = (radius_px + 0.5 - away.length()).clamp(0.0, 1.0) as f32;
                let inside = self.view.mask.get(x, y) == Some(&true);
                if let Some(pixel) = self.view.photo.get(x, y)
                    && inside
                    && weight > 0.0
                {
                    for (sum, &level) in sum.iter_mut().zip(pixel) {
                        *sum += weight * self.levels[level as usize];
                    }
                    total += weight;
                }
            }
        }
        (total > 0.0).then(|| sum.map(|v| v / total))
    }
}

/// Smooth step: 0 below 0, 1 above 1
fn smooth_step(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Returns the linear light of each level stored in files
fn linear_levels() -> [f32; 256] {
    std::array::from_fn(|level| render::linear_from_srgb(level as f32 / 255.0))
}

/// Computes the consensus color of views, and the sum of their weights; outlying colors lose weight
fn consensus<'a>(view_colors: impl Iterator<Item = &'a ViewColor> + Clone) -> (DVec3, f64) {
    let color = |view: &ViewColor| DVec3::from_array(view.color.map(f64::from));
    let root = |color: DVec3| DVec3::new(color.x.sqrt(), color.y.sqrt(), color.z.sqrt());
    let mean = |oddness: &dyn Fn(DVec3) -> f64| {
        let (mut sum, mut total) = (DVec3::ZERO, 0.0);
        for view in view_colors.clone() {
            let weight = f64::from(view.weight) / (1.0 + oddness(color(view)));
            sum += color(view) * weight;
            total += weight;
        }
        if total > 0.0 {
            sum / total
        } else {
            DVec3::ZERO
        }
    };
    let mut agreed = mean(&|_| 0.0);
    for _ in 0..AGREE_ROUNDS {
        let around = root(agreed);
        agreed = mean(&|color| ((root(color) - around).length() / ODD_COLOR).powi(2));
    }
    let total = view_colors.map(|view| f64::from(view.weight)).sum();
    (agreed, total)
}

/// Rounds of reweighting outlying colors: enough for two views to outvote one of higher weight
const AGREE_ROUNDS: usize = 4;

/// Completes colors of different weight: unseen vertices are filled from their neighborhood, uncertain ones partly
///
/// `None` when no vertex has any weight.
fn fill(agreed: &[(DVec3, f64)], neighbors: &Neighbors, rounds: usize) -> Option<Vec<DVec3>> {
    let trust: Vec<f64> = agreed
        .iter()
        .map(|(_, weight)| smooth_step(weight / SURE_WEIGHT))
        .collect();
    let mut front: Vec<usize> = (0..agreed.len()).filter(|&v| trust[v] > 0.0).collect();
    if front.is_empty() {
        return None;
    }
    let total: f64 = trust.iter().sum();
    let mean = agreed.iter().zip(&trust).map(|((c, _), t)| *c * *t);
    let mean = mean.sum::<DVec3>() / total;
    let mut colors: Vec<Option<DVec3>> = vec![None; agreed.len()];
    for &v in &front {
        colors[v] = Some(agreed[v].0);
    }
    // Ring by ring, so that smoothing starts near its solution.
    while !front.is_empty() {
        let mut ring: Vec<usize> = front
            .iter()
            .flat_map(|&v| neighbors.of(v))
            .map(|&n| n as usize)
            .filter(|&n| colors[n].is_none())
            .collect();
        ring.sort_unstable();
        ring.dedup();
        let found: Vec<DVec3> = ring
            .iter()
            .map(|&v| {
                let around = neighbors.of(v).iter().filter_map(|&n| colors[n as usize]);
                let (sum, count) = around.fold((DVec3::ZERO, 0.0), |(s, c), p| (s + p, c + 1.0));
                sum / f64::max(count, 1.0)
            })
            .collect();
        for (&v, color) in ring.iter().zip(found) {
            colors[v] = Some(color);
        }
        front = ring;
    }
    let mut colors: Vec<DVec3> = colors.into_iter().map(|c| c.unwrap_or(mean)).collect();
    let open: Vec<usize> = (0..agreed.len())
        .filter(|&v| trust[v] < 1.0 && !neighbors.of(v).is_empty())
        .collect();
    for _ in 0..rounds {
        for &v in &open {
            let around = neighbors.of(v);
            let sum: DVec3 = around.iter().map(|&n| colors[n as usize]).sum();
            let smooth = sum / around.len() as f64;
            colors[v] = agreed[v].0 * trust[v] + smooth * (1.0 - trust[v]);
        }
    }
    Some(colors)
}

/// The vertices that share an edge with each vertex
struct Neighbors {
    /// Neighbors of vertex `v`: `all[first[v]..first[v + 1]]`
    first: Vec<u32>,
    all: Vec<u32>,
}

impl Neighbors {
    fn new(edges: &[[u32; 2]], vertex_count: usize) -> Self {
        let mut first = vec![0u32; vertex_count + 1];
        for &v in edges.iter().flatten() {
            first[v as usize + 1] += 1;
        }
        for v in 1..first.len() {
            first[v] += first[v - 1];
        }
        let mut next = first.clone();
        let mut all = vec![0; 2 * edges.len()];
        for &[a, b] in edges {
            for (from, to) in [(a, b), (b, a)] {
                let slot = &mut next[from as usize];
                all[*slot as usize] = to;
                *slot += 1;
            }
        }
        Self { first, all }
    }

    fn of(&self, vertex: usize) -> &[u32] {
        &self.all[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }

    /// Computes the mean distance of each vertex from its neighbors, in mm
    fn spacings(&self, positions: &[DVec3]) -> Vec<f64> {
        let spacing = |(v, p): (usize, &DVec3)| {
            let around = self.of(v);
            let lengths = around
                .iter()
                .map(|&n| (positions[n as usize] - *p).length());
            lengths.sum::<f64>() / around.len().max(1) as f64
        };
        positions.iter().enumerate().map(spacing).collect()
    }
}

#[cfg(test)]
mod tests;
