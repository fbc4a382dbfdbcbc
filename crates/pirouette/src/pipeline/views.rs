//! Single views as normalizing, carving and measuring take them.

use pirouette_geom::TriMesh;
use rayon::prelude::*;

use crate::body_fit::{Fit, OutlineTargets, RimMesh};
use crate::carve::CarveView;
use crate::measure::MeasureView;
use crate::normalize::{
    NormalizeError, NormalizeOptions, NormalizeView, NormalizedView, ReferenceView, RefineOptions,
    RegisterOptions, normalize, shared_skeleton_joints,
};
use crate::pipeline::{Config, Method, ViewReport};
use crate::skeleton_fit::Bundle;
use pirouette_body::Avatar;
use pirouette_body::Pose;
use pirouette_body::render::SilhouetteMesh;
use pirouette_geom::outline_map::OutlineMap;

/// The steps that a configuration asks for
fn normalize_options(config: &Config) -> NormalizeOptions {
    let options = match config.method {
        Method::Fit => NormalizeOptions::fitted_body(),
        Method::ThreeStep => NormalizeOptions::three_step(),
    };
    NormalizeOptions {
        register: config.register.then(RegisterOptions::default),
        refine: config.refine.then(RefineOptions::default),
        ..options
    }
}

/// What normalizing the views has in common
pub(super) struct Normalizer<'a> {
    bundle: &'a Bundle,
    fit: Option<&'a Fit>,
    reference: &'a Avatar,
    mesh: SilhouetteMesh,
    rim: Option<RimMesh>,
    options: NormalizeOptions,
}

impl<'a> Normalizer<'a> {
    /// `avatar` is the reference where no body was fitted
    pub(super) fn new(
        config: &Config,
        avatar: &'a Avatar,
        bundle: &'a Bundle,
        fit: Option<&'a Fit>,
    ) -> Self {
        // The published method knows the person's proportions from the photo alone.
        let reference = fit.map_or(avatar, |fit| &fit.avatar);
        let TriMesh {
            positions,
            triangles,
        } = &reference.mesh;
        Self {
            bundle,
            fit,
            reference,
            mesh: SilhouetteMesh::new(triangles),
            rim: fit.map(|_| RimMesh::new(triangles, positions.len())),
            options: normalize_options(config),
        }
    }

    /// Brings a view to the reference pose; `place` is that of its pose in the fit
    pub(super) fn normalize(
        &self,
        place: usize,
        view: &ViewReport,
    ) -> Result<NormalizedView, NormalizeError> {
        let bundle = self.bundle;
        let (turn, camera) = (bundle.turns[view.index], &bundle.cameras[view.index]);
        let (skeleton, pose) = match self.fit {
            Some(fit) => (&fit.avatar, &fit.poses[place]),
            None => (&bundle.avatar, &bundle.poses[view.index]),
        };
        let outline = self.fit.zip(self.rim.as_ref());
        let outline = outline.map(|(fit, rim)| OutlineTargets::new(fit, rim, place, turn, camera));
        normalize(
            &NormalizeView {
                mask: &view.silhouette.mask,
                soft: &view.silhouette.soft,
                keypoints: &bundle.keypoints[view.index],
                skeleton: Some(&shared_skeleton_joints(skeleton, pose, turn, camera)),
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

/// Outlines of the normalized silhouettes, in the order of the views
pub(super) fn normalized_outlines(views: &[ViewReport]) -> Vec<OutlineMap> {
    let outline = |normalized: &NormalizedView| {
        // Soft silhouettes of all views at once would be the largest part of a job's memory.
        OutlineMap::new(&normalized.soft(), OutlineMap::FAR_PX)
    };
    let normalized = views.par_iter().filter_map(|view| view.normalized.as_ref());
    normalized.map(outline).collect()
}

/// Outlines of the photographed silhouettes, in the order of the views
pub(super) fn photographed_outlines(views: &[ViewReport]) -> Vec<OutlineMap> {
    let outline =
        |view: &ViewReport| OutlineMap::new(&view.silhouette.soft.whole(), OutlineMap::NEAR_PX);
    views.par_iter().map(outline).collect()
}

/// Silhouettes as measuring sees them: photographed ones where the body's poses are known, else normalized ones
pub(super) fn measure_views<'a>(
    bundle: &Bundle,
    fit: Option<&Fit>,
    views: &[ViewReport],
    outlines: &'a [OutlineMap],
) -> Vec<MeasureView<'a>> {
    let views = views.iter().zip(outlines).enumerate();
    views
        .map(|(place, (view, outline))| MeasureView {
            outline,
            camera: bundle.cameras[view.index],
            turn: bundle.turns[view.index],
            pose: fit.map_or(Pose::default(), |fit| fit.poses[place]),
        })
        .collect()
}

/// The normalized silhouettes as carving sees them
pub(super) fn carve_views<'a>(
    bundle: &Bundle,
    views: &[ViewReport],
    normalized: &'a [OutlineMap],
) -> Vec<CarveView<'a>> {
    let views = views.iter().zip(normalized);
    views
        .map(|(view, outline)| CarveView {
            outline,
            camera: bundle.cameras[view.index],
            turn: bundle.turns[view.index],
        })
        .collect()
}
