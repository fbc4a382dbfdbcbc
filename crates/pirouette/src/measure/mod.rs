//! Tape measurements of a body.
//!
//! Each girth is found twice: from the outlines of the photos, by support lines (see `support`), and along a section
//! of the fitted body. Both are told, with their mean by variances. The fitted body tells where tapes lie, by
//! definition on the shape it has (`landmarks`), and which outline belongs to which limb. Heights and lengths are
//! taken on it. What cannot be had is left out with the reason.

mod figure;
mod girths;
mod landmarks;
mod lengths;
mod mass;
mod names;
mod prior;
mod support;
mod tape;
mod value;

use glam::DVec3;
use pirouette_geom::TriMesh;
use rayon::prelude::*;

use crate::scan::{StatureFrom, Subject};
use figure::Figure;
pub use figure::measure_figure;
pub use mass::BodyMass;
pub use names::{Girth, Landmark, Measure};
use pirouette_body::Avatar;
use pirouette_body::Camera;
use pirouette_body::TurnAngle;
use pirouette_body::render::SilhouetteMesh;
use pirouette_body::{Pose, pose_bones};
use pirouette_geom::outline_map::OutlineMap;
use support::SeenView;
pub use value::{Estimate, LengthUnit, Measured, Measurements, Method, Unavailable};

/// A silhouette of the person
#[derive(Debug, Clone, Copy)]
pub struct MeasureView<'a> {
    /// Distances to the outline of its soft coverage, of any reach
    pub outline: &'a OutlineMap,
    /// The camera that saw it
    pub camera: Camera,
    /// How far the person had turned
    pub turn: TurnAngle,
    /// The pose in which the figure explains it; the default for silhouettes in the reference pose
    pub pose: Pose,
}

/// What to measure, all in the world frame, mm
#[derive(Debug, Clone, Copy)]
pub struct MeasureInput<'a> {
    /// The body
    pub body: &'a TriMesh,
    /// The fitted body, or the reference figure with the person's bone lengths, in the reference pose
    pub avatar: &'a Avatar,
    /// Whether the avatar is the person's own body
    pub fitted: bool,
    /// Silhouettes of the person
    pub views: &'a [MeasureView<'a>],
    /// Height of the person, if known; without, results are in units of it
    pub stature_mm: Option<f64>,
    /// How it is known
    pub stature_from: StatureFrom,
    /// What the person told besides
    pub subject: Subject,
    /// Share of the views whose silhouettes were given, not found in photos
    pub given_masks: f64,
}

impl MeasureInput<'_> {
    /// A deviation between those from photos and by given silhouettes
    fn between(&self, photos: f64, given: f64) -> f64 {
        photos + (given - photos) * self.given_masks.clamp(0.0, 1.0)
    }
}

/// Measures a body
///
/// Never fails as a whole: what cannot be had is missing with its reason.
pub fn measure(input: &MeasureInput) -> Measurements {
    let avatar = input.avatar;
    let see_views = || -> Vec<SeenView> {
        let edges = SilhouetteMesh::new(&avatar.mesh.triangles);
        let views = input.views.par_iter().filter(|v| !v.outline.is_empty());
        views.map(|view| see(avatar, &edges, view)).collect()
    };
    let (views, figure) = rayon::join(see_views, || Figure::new(avatar));
    let scale_sd = lengths::scale_sd(input);
    let values = Measure::ALL.into_par_iter().map(|measure| {
        let measured = match measure {
            Measure::Stature => lengths::stature(input),
            _ if !measure.girths().is_empty() => girths::find(input, &figure, &views, measure),
            _ => lengths::find(input, &figure, measure),
        };
        let measured = measured.with_scale_sd(scale_sd);
        (measure, prior::support(input, measure, measured))
    });
    let values: Vec<(Measure, Measured)> = values.collect();
    let height = values.iter().find(|(m, _)| *m == Measure::Stature);
    let height_mm = height.and_then(|(_, found)| found.value_mm.ok());
    Measurements {
        stature: input.stature_mm.map(|_| input.stature_from),
        height_mm: height_mm.unwrap_or(avatar.stature_mm()),
        values,
        subject: input.subject,
        mass: mass::find(input, scale_sd),
        tapes: figure.tape_curves(),
    }
}

/// A view with the figure as it should show it
fn see<'a>(avatar: &Avatar, edges: &SilhouetteMesh, view: &MeasureView<'a>) -> SeenView<'a> {
    let posed = pose_bones(&avatar.bone_heads, &view.pose, view.turn);
    let positions: Vec<DVec3> = posed.skin(&avatar.mesh.positions, &avatar.weights);
    let expected = edges.silhouette(&positions, &view.camera);
    SeenView::new(view.outline, view.camera, posed, &expected)
}

#[cfg(test)]
mod tests;
