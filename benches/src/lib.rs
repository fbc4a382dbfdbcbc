//! Input of the benchmarks: one rendered person, and the output of each stage as the input of the next.
//!
//! All inputs follow from constants, so that two runs measure the same work.

use glam::DVec2;
use pirouette::carve::{CarveError, CarveOptions, CarveView, carve};
use pirouette::normalize::deform::{Handles, handles, trace_silhouette};
use pirouette::normalize::{
    ContourSource, NormalizeMethod, NormalizeOptions, NormalizeView, NormalizedView, ReferenceView,
    normalize, shared_skeleton_joints,
};
use pirouette::pipeline::render_priors;
use pirouette::segment::{SegmentOptions, SegmentView, Silhouette, segment};
use pirouette::skeleton_fit::{
    KeypointView, Skeleton, SkeletonFitOptions, SkeletonView, fit_skeleton,
};
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::render::SilhouetteMesh;
use pirouette_body::{Avatar, PerJoint, Sex};
use pirouette_geom::contour::{Contour, trace_outline};
use pirouette_geom::outline_map::OutlineMap;
use pirouette_geom::planar_mesh::{PlanarMesh, TriangulateOptions, simplify_apart, triangulate};
use pirouette_geom::{Grid, Mask, TriMesh};
use pirouette_synthetic::{Clutter, SyntheticOptions, SyntheticScan, synthesize};
use rayon::prelude::*;

/// Columns and rows of the photos for timing the stages
pub const PHOTO_SIZE_PX: (usize, usize) = (800, 1000);

/// Number of views for timing the stages
pub const VIEW_COUNT: usize = 8;

/// Tolerance of the simplification of outlines for meshing, in px, as in the pipeline
const TOLERANCE_PX: f64 = 1.0;

/// Distance of the outline points used by the registration, in px, as in the pipeline
const OUTLINE_SPACING_PX: f64 = 2.0;

/// Photographs a person with sway and of another build than the reference in a furnished room
///
/// # Panics
/// Never: stature and mass of the person are ordinary.
pub fn photograph(width_px: usize, height_px: usize, view_count: usize) -> SyntheticScan {
    let person = mannequin(&MannequinParameters {
        sex: Sex::Female,
        stature_mm: Some(1660.0),
        mass_kg: Some(72.0),
        ..MannequinParameters::default()
    })
    .expect("valid stature and mass");
    synthesize(
        &person,
        &SyntheticOptions {
            seed: 1,
            turns: SyntheticOptions::even_turns(view_count),
            camera: SyntheticOptions::camera_for(person.stature_mm(), width_px, height_px),
            sway: 1.0,
            keypoint_noise_px: 2.5,
            turn_noise_radians: 0.0,
            sensor_noise: 2.0,
            clutter: Clutter::LivedIn,
            photos: true,
        },
    )
}

/// A scan and the results of the stages, up to silhouettes aligned as published
#[derive(Debug)]
pub struct Stages {
    /// Photos, keypoints, ground truth
    pub synthetic: SyntheticScan,
    /// The reference avatar
    pub avatar: Avatar,
    /// One skeleton for all views
    pub skeleton: Skeleton,
    /// The views as explained by the skeleton
    pub views: Vec<SkeletonView>,
    /// Coverage of the avatar in the pose of the person, per view
    pub priors: Vec<Mask>,
    /// The person in each photo
    pub silhouettes: Vec<Silhouette>,
    /// The avatar in the reference pose, per view
    pub references: Vec<ReferenceView>,
    /// Silhouettes after alignment (eq. 1), neither registered nor refined
    pub aligned: Vec<NormalizedView>,
}

/// Contours and points inside them, for triangulation without additional points
#[derive(Debug)]
pub struct PlanarPoints {
    /// Closed outlines, holes in the opposite orientation
    pub contours: Vec<Contour>,
    /// Interior points with a distance from the outlines
    pub interior: Vec<DVec2>,
}

/// A mesh with constrained vertices
#[derive(Debug)]
pub struct HeldMesh {
    /// The rest mesh
    pub mesh: PlanarMesh,
    /// The constrained vertices
    pub constrained: Vec<u32>,
    /// Target positions of the constrained vertices, in px
    pub targets: Vec<DVec2>,
}

impl Stages {
    /// Renders the scan and runs the stages
    ///
    /// # Panics
    /// When a stage fails on the rendered person.
    pub fn new() -> Self {
        let synthetic = photograph(PHOTO_SIZE_PX.0, PHOTO_SIZE_PX.1, VIEW_COUNT);
        let scan = &synthetic.scan;
        let avatar = mannequin(&MannequinParameters {
            stature_mm: scan.stature_mm,
            ..MannequinParameters::default()
        })
        .expect("valid stature");
        let (skeleton, views) = fit_shared_skeleton(&avatar, &synthetic);
        let priors = render_priors(&skeleton.avatar, &views, &|| ());
        let silhouettes: Vec<Silhouette> = {
            let views = segment_views(&synthetic, &priors);
            segment(&views, None, &SegmentOptions::default(), &|| false)
                .into_iter()
                .map(|found| found.expect("the rendered person is found"))
                .collect()
        };
        let mesh = SilhouetteMesh::new(&avatar.mesh.triangles);
        let references: Vec<ReferenceView> = views
            .iter()
            .map(|view| {
                let method = NormalizeMethod::ThreeStep;
                ReferenceView::render(&avatar, &mesh, view.turn, &view.camera, method)
            })
            .collect();
        let options = NormalizeOptions {
            register: None,
            refine: None,
            ..NormalizeOptions::three_step()
        };
        let aligned = (0..silhouettes.len())
            .map(|view| {
                let view = normalize_view(&silhouettes, &views, &references, view);
                normalize(&view, &options).expect("the rendered person is normalized")
            })
            .collect();
        Self {
            synthetic,
            avatar,
            skeleton,
            views,
            priors,
            silhouettes,
            references,
            aligned,
        }
    }

    /// Returns the input of the segmentation
    pub fn segment_views(&self) -> Vec<SegmentView<'_>> {
        segment_views(&self.synthetic, &self.priors)
    }

    /// Returns the input of the normalization
    pub fn normalize_view(&self, view: usize) -> NormalizeView<'_> {
        normalize_view(&self.silhouettes, &self.views, &self.references, view)
    }

    /// Returns the exact silhouettes of the person without sway
    pub fn still_silhouettes(&self) -> Vec<Grid<f32>> {
        let masks = self.synthetic.truth.canonical.iter();
        masks
            .map(|mask| mask.map(|&inside| f32::from(u8::from(inside))))
            .collect()
    }

    /// Returns the input of carving, with the true camera
    pub fn carve_views<'a>(&self, outlines: &'a [OutlineMap]) -> Vec<CarveView<'a>> {
        let camera = self.synthetic.truth.camera;
        let views = self.synthetic.scan.views.iter();
        outlines
            .iter()
            .zip(views)
            .map(|(outline, view)| CarveView {
                outline,
                camera,
                turn: view.turn,
            })
            .collect()
    }

    /// Carves soft silhouettes of all views, including the computation of their outline maps
    ///
    /// # Errors
    /// Those of [`carve`].
    pub fn carve(&self, silhouettes: &[Grid<f32>]) -> Result<TriMesh, CarveError> {
        let outlines = far_outlines(silhouettes);
        carve(&self.carve_views(&outlines), &CarveOptions::default())
    }

    /// Returns evenly spaced points of the aligned outline of a view, as input of the registration
    pub fn outline_points(&self, view: usize) -> Vec<DVec2> {
        trace_outline(&self.aligned[view].soft(), 0.5)
            .iter()
            .flat_map(|contour| contour.resample(OUTLINE_SPACING_PX).points)
            .collect()
    }

    /// Returns the outline of a view's silhouette, simplified as for meshing, and its handles
    pub fn outline_with_handles(&self, view: usize) -> (Vec<Contour>, Handles) {
        let silhouette = &self.silhouettes[view];
        let soft = &silhouette.soft;
        let contours = trace_silhouette(&silhouette.mask, soft, ContourSource::Outline);
        let spacing = TriangulateOptions::default().spacing_px();
        let stays = simplify_apart(&contours, TOLERANCE_PX, spacing.unwrap_or(f64::INFINITY));
        let simple = contours.iter().zip(stays).map(|(contour, stays)| Contour {
            points: stays.into_iter().map(|i| contour.points[i]).collect(),
            hole: contour.hole,
        });
        let joints = shared_skeleton_joints(
            &self.skeleton.avatar,
            &self.views[view].pose,
            self.views[view].turn,
            &self.views[view].camera,
        );
        let known = |joints: PerJoint<DVec2>| joints.map(Some);
        let spread = handles(&known(joints.photo), &known(joints.reference), |_| true);
        (simple.collect(), spread)
    }

    /// Returns the mesh of a view's silhouette with its handles
    ///
    /// # Panics
    /// When the silhouette is empty.
    pub fn held_mesh(&self, view: usize) -> HeldMesh {
        let (contours, spread) = self.outline_with_handles(view);
        let meshed = triangulate(&contours, &spread.sources, &TriangulateOptions::default())
            .expect("the silhouette is not empty");
        let mut held: Vec<(u32, DVec2)> = meshed
            .interior_vertices
            .iter()
            .zip(&spread.targets)
            .filter_map(|(vertex, &target)| Some(((*vertex)?, target)))
            .collect();
        // Handles that share a vertex are merged.
        held.sort_by_key(|&(vertex, _)| vertex);
        held.dedup_by_key(|&mut (vertex, _)| vertex);
        let (constrained, targets) = held.into_iter().unzip();
        HeldMesh {
            mesh: meshed.mesh,
            constrained,
            targets,
        }
    }

    /// Returns the points of that mesh, for triangulating them again
    pub fn planar_points(&self, view: usize) -> PlanarPoints {
        let mesh = self.held_mesh(view).mesh;
        let mut next: Vec<Option<u32>> = vec![None; mesh.positions.len()];
        for [from, to] in mesh.boundary_edges() {
            next[from as usize] = Some(to);
        }
        let interior = (mesh.positions.iter().zip(&next))
            .filter(|(_, next)| next.is_none())
            .map(|(&point, _)| point)
            .collect();
        let mut contours = Vec::new();
        for start in 0..next.len() {
            let mut points = Vec::new();
            let mut at = start;
            while let Some(to) = next[at].take() {
                points.push(mesh.positions[at]);
                at = to as usize;
            }
            if !points.is_empty() {
                let mut contour = Contour {
                    points,
                    hole: false,
                };
                contour.hole = contour.signed_area() < 0.0;
                contours.push(contour);
            }
        }
        PlanarPoints { contours, interior }
    }

    /// Returns the masks found by the segmentation
    pub fn masks(&self) -> impl Iterator<Item = &Mask> {
        self.silhouettes.iter().map(|found| &found.mask)
    }
}

impl Default for Stages {
    fn default() -> Self {
        Self::new()
    }
}

/// Computes the outline maps used by carving
pub fn far_outlines(silhouettes: &[Grid<f32>]) -> Vec<OutlineMap> {
    let silhouettes = silhouettes.par_iter();
    silhouettes
        .map(|silhouette| OutlineMap::new(silhouette, OutlineMap::FAR_PX))
        .collect()
}

/// Fits the skeleton of all views
///
/// # Panics
/// When no skeleton fits the keypoints of the rendered person.
pub fn fit_shared_skeleton(
    avatar: &Avatar,
    synthetic: &SyntheticScan,
) -> (Skeleton, Vec<SkeletonView>) {
    let scan = &synthetic.scan;
    let views: Vec<KeypointView> = scan.views.iter().map(KeypointView::from).collect();
    let options = SkeletonFitOptions::default();
    fit_skeleton(avatar, &views, &scan.camera, scan.stature_mm, &options).expect("a skeleton")
}

fn segment_views<'a>(synthetic: &'a SyntheticScan, priors: &'a [Mask]) -> Vec<SegmentView<'a>> {
    synthetic
        .scan
        .views
        .iter()
        .zip(priors)
        .map(|(view, prior)| SegmentView {
            photo: &view.photo,
            keypoints: &view.keypoints,
            prior: Some(prior),
            mask: None,
            person_odds: None,
        })
        .collect()
}

fn normalize_view<'a>(
    silhouettes: &'a [Silhouette],
    views: &'a [SkeletonView],
    references: &'a [ReferenceView],
    view: usize,
) -> NormalizeView<'a> {
    NormalizeView {
        mask: &silhouettes[view].mask,
        soft: &silhouettes[view].soft,
        keypoints: &views[view].keypoints,
        skeleton: None,
        outline: None,
        reference: &references[view],
    }
}
