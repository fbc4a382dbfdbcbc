//! Stages as functions from views to results, for the pipeline and for studies of single stages.

use pirouette_body::gltf::{HullUsed, load_avatar_with_hull};
use pirouette_body::mannequin::{MannequinParameters, mannequin};
use pirouette_body::render::SilhouetteMesh;
use pirouette_body::{Avatar, Camera, Pose};
use pirouette_geom::morphology::erode;
use pirouette_geom::outline_map::OutlineMap;
use pirouette_geom::parallel::prelude::*;
use pirouette_geom::{Grid, Mask, TriMesh};

use crate::body_fit::{ContourMesh, OutlineTargets};
use crate::carve::CarveView;
use crate::measure::MeasureView;
use crate::normalize::{
    NormalizeError, NormalizeOptions, NormalizeView, NormalizedView, ReferenceView, RefineOptions,
    RegisterOptions, normalize, shared_skeleton_joints,
};
use crate::pipeline::{AvatarSource, Config, Method, PipelineError, Report};
use crate::scan::Scan;
use crate::skeleton_fit::SkeletonView;
use crate::view::SolvedView;

/// Builds or loads the reference avatar of a job, at the stature of the person; also returns how the surface of a file was
/// closed
///
/// # Errors
/// When there is no such mannequin, or the file cannot be used.
pub fn make_avatar(
    scan: &Scan,
    source: &AvatarSource,
) -> Result<(Avatar, Option<HullUsed>), PipelineError> {
    match source {
        AvatarSource::Mannequin { sex, mass_kg } => {
            let parameters = MannequinParameters {
                sex: *sex,
                stature_mm: scan.stature_mm,
                mass_kg: *mass_kg,
                pose: scan.pose,
                ..MannequinParameters::default()
            };
            Ok((mannequin(&parameters)?, None))
        }
        AvatarSource::File { name, bytes } => {
            let loaded = load_avatar_with_hull(bytes, scan.pose);
            let (avatar, hull) = loaded.map_err(|source| PipelineError::Avatar {
                name: name.clone(),
                source,
            })?;
            let avatar = match scan.stature_mm {
                Some(stature_mm) => avatar.scaled_to(stature_mm),
                None => avatar,
            };
            Ok((avatar, hull))
        }
    }
}

/// Renders the silhouette of the avatar in the person's pose, for each view
///
/// `avatar` has the person's bone lengths. `on_view_done` is called from any thread.
pub fn render_priors(
    avatar: &Avatar,
    views: &[SkeletonView],
    on_view_done: &(dyn Fn() + Sync),
) -> Vec<Mask> {
    let mesh = SilhouetteMesh::new(&avatar.mesh.triangles);
    let render = |view: &SkeletonView| {
        let positions = avatar.posed(&view.pose, view.turn).positions;
        let coverage = mesh.silhouette(&positions, &view.camera);
        on_view_done();
        coverage.threshold(0.5)
    };
    views.par_iter().map(render).collect()
}

/// Normalizes views; data common to all views is prepared once
#[derive(Debug)]
pub struct Normalizer<'a> {
    /// The avatar that the poses of the views refer to
    person: &'a Avatar,
    reference: &'a Avatar,
    mesh: SilhouetteMesh,
    contour_mesh: Option<ContourMesh>,
    options: NormalizeOptions,
}

impl<'a> Normalizer<'a> {
    /// Prepares the steps selected by a configuration; `None` without a skeleton
    pub fn new(config: &Config, report: &'a Report) -> Option<Self> {
        let options = match config.method {
            Method::Fit => NormalizeOptions::fitted_body(),
            Method::ThreeStep => NormalizeOptions::three_step(),
        };
        let options = NormalizeOptions {
            register: config.register.then(RegisterOptions::default),
            refine: config.refine.then(RefineOptions::default),
            ..options
        };
        let reference = report.normalization_reference();
        let mut normalizer = Self::with_options(report.person()?, reference, options);
        let TriMesh {
            positions,
            triangles,
        } = &reference.mesh;
        normalizer.contour_mesh = report
            .fit
            .as_ref()
            .map(|_| ContourMesh::new(triangles, positions.len()));
        Some(normalizer)
    }

    /// Prepares normalization without a fitted body: the poses refer to `person`, `reference` is the target
    pub fn with_options(
        person: &'a Avatar,
        reference: &'a Avatar,
        options: NormalizeOptions,
    ) -> Self {
        Self {
            person,
            reference,
            mesh: SilhouetteMesh::new(&reference.mesh.triangles),
            contour_mesh: None,
            options,
        }
    }

    /// Transforms the silhouette of a view to the reference pose
    ///
    /// # Errors
    /// As [`normalize`].
    pub fn normalize(&self, view: &SolvedView) -> Result<NormalizedView, NormalizeError> {
        let SkeletonView {
            turn,
            camera,
            keypoints,
            pose,
            ..
        } = view.skeleton();
        let (turn, fit) = (*turn, view.fit.as_ref());
        let pose = fit.map_or(pose, |fit| &fit.pose);
        let outline = self.contour_mesh.as_ref();
        let outline =
            outline.map(|mesh| OutlineTargets::new(self.person, mesh, pose, turn, camera));
        normalize(
            &NormalizeView {
                mask: &view.silhouette.mask,
                soft: &view.silhouette.soft,
                keypoints,
                skeleton: Some(&shared_skeleton_joints(self.person, pose, turn, camera)),
                outline: outline.as_ref(),
                reference: &ReferenceView::render(
                    self.reference,
                    &self.mesh,
                    turn,
                    camera,
                    self.options.method,
                ),
            },
            &self.options,
        )
    }
}

/// Computes the outlines of the normalized silhouettes, in the order of the views
pub fn normalized_outlines(views: &[SolvedView]) -> Vec<OutlineMap> {
    let outline = |normalized: &NormalizedView| {
        // Soft silhouettes of all views at once would be the largest part of a job's memory.
        OutlineMap::new(&normalized.soft(), OutlineMap::FAR_PX)
    };
    let normalized = views.par_iter().filter_map(|view| view.normalized.as_ref());
    normalized.map(outline).collect()
}

/// Depth below the surface of the reference avatar from which on its silhouette is inside that of anybody, in mm
///
/// Silhouettes are normalized to the pose and the stature of the avatar; a limb of a thin person is within 20 mm of it.
const CORE_DEPTH_MM: f64 = 16.0;

/// Computes the outlines of the normalized silhouettes, united with the core of the avatar's
///
/// A limb that a silhouette lost, since it lay before the trunk or followed wrong joints, would otherwise be cut off by this
/// one view.
pub(super) fn outlines_with_core(views: &[SolvedView], avatar: &Avatar) -> Vec<OutlineMap> {
    let mesh = SilhouetteMesh::new(&avatar.mesh.triangles);
    let outline = |view: &SolvedView| {
        let mut soft = view.normalized.as_ref()?.soft();
        let SkeletonView { camera, turn, .. } = *view.skeleton();
        let positions = avatar.posed(&Pose::default(), turn).positions;
        add_core(&mut soft, &mesh.silhouette(&positions, &camera), &camera);
        Some(OutlineMap::new(&soft, OutlineMap::FAR_PX))
    };
    views.par_iter().filter_map(outline).collect()
}

/// Fills a silhouette where that of the avatar is deeper than [`CORE_DEPTH_MM`]
fn add_core(soft: &mut Grid<f32>, avatar: &Grid<f32>, camera: &Camera) {
    let depth_px = CORE_DEPTH_MM * camera.focal_px() / camera.distance_mm;
    let core = erode(&avatar.threshold(0.5), depth_px);
    for (soft, core) in soft.as_mut_slice().iter_mut().zip(core.as_slice()) {
        if *core {
            *soft = 1.0;
        }
    }
}

/// Computes the outlines of the photographed silhouettes, in the order of the views
pub fn photographed_outlines(views: &[SolvedView]) -> Vec<OutlineMap> {
    let outline =
        |view: &SolvedView| OutlineMap::new(&view.silhouette.soft.to_grid(), OutlineMap::NEAR_PX);
    views.par_iter().map(outline).collect()
}

/// Returns the silhouettes to measure: photographed ones for a fitted body, normalized ones otherwise
pub(super) fn measure_views<'a>(
    views: &[SolvedView],
    outlines: &'a [OutlineMap],
) -> Vec<MeasureView<'a>> {
    let views = views.iter().zip(outlines);
    views
        .map(|(view, outline)| MeasureView {
            outline,
            camera: view.skeleton().camera,
            turn: view.skeleton().turn,
            pose: view.fit.map_or(Pose::default(), |fit| fit.pose),
        })
        .collect()
}

/// Returns the silhouettes in the reference pose to carve, with their outlines
pub fn carve_views<'a>(views: &[SolvedView], outlines: &'a [OutlineMap]) -> Vec<CarveView<'a>> {
    let views = views.iter().zip(outlines);
    views
        .map(|(view, outline)| CarveView {
            outline,
            camera: view.skeleton().camera,
            turn: view.skeleton().turn,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pirouette_synthetic::SyntheticOptions;

    #[test]
    fn the_core_restores_lost_limbs_and_changes_no_complete_silhouette() {
        let avatar = mannequin(&MannequinParameters::default()).unwrap();
        let camera = SyntheticOptions::camera_for(avatar.stature_mm(), 240, 300);
        let mesh = SilhouetteMesh::new(&avatar.mesh.triangles);
        let complete = mesh.silhouette(&avatar.mesh.positions, &camera);
        let mut same = complete.clone();
        add_core(&mut same, &complete, &camera);
        assert_eq!(same.threshold(0.5), complete.threshold(0.5));

        // A silhouette without its right half
        let half = complete.width() / 2;
        let left = |x: usize, y: usize| if x < half { complete[(x, y)] } else { 0.0 };
        let mut restored = Grid::from_fn(complete.width(), complete.height(), left);
        add_core(&mut restored, &complete, &camera);
        let inside = restored.as_slice().iter().zip(complete.as_slice());
        assert!(
            inside
                .clone()
                .all(|(restored, whole)| restored <= whole || *whole >= 0.5)
        );
        let wrist = camera.project(avatar.keypoints[pirouette_body::Joint::LeftElbow]);
        assert!(restored[(wrist.x as usize, wrist.y as usize)] > 0.5);
        let area = restored.threshold(0.5).area() as f64 / complete.threshold(0.5).area() as f64;
        assert!((0.7..0.95).contains(&area), "{area}");
    }
}
