//! Stage 2: from silhouettes to pose-normalized silhouettes.
//!
//! Each silhouette is deformed from the pose in its photo to the reference pose: [`align`] computes targets for the
//! joints, [`deform`] moves the silhouette with them, [`register`] moves the result rigidly onto the reference
//! silhouette and [`refine`] bends arms and legs onto it, after which the silhouette is deformed once more with the
//! corrected joints as targets.
//!
//! The result has the size of the photo and lies in the frame of the reference view: as the camera would see the person
//! standing in the reference pose on the turning axis, turned like the view.
//!
//! A silhouette contains no depth: an arm in front of the trunk moves with the trunk's surface around it, and parts
//! that it hid remain hidden.

pub mod align;
pub mod deform;
mod descent;
mod parts;
pub mod refine;
pub mod register;

use glam::DVec2;
use pirouette_geom::chain::RigidMotion;
use pirouette_geom::contour::Contour;
use pirouette_geom::{Grid, Mask, Windowed};

use crate::body_fit::OutlineTargets;
use pirouette_body::render::{SilhouetteMesh, visible_bones};
use pirouette_body::{Avatar, Camera, Keypoints, PerBone, PerJoint, Pose, PosedAvatar, TurnAngle};

pub use align::{SkeletonJoints, shared_skeleton_joints};
pub use deform::{ContourSource, DeformError, DeformOptions};
pub use refine::{JointPositions, LimbRefinement, RefineOptions};
pub use register::{RegisterOptions, Registration};

use deform::{DeformableSilhouette, Handles, fill_contours, handles, trace_silhouette};
use register::ReferenceContourMap;

/// Distance between the contour points that registration and refinement compare, in px
///
/// Every point of a traced contour would be redundant.
const CONTOUR_SPACING_PX: f64 = 2.0;

/// Source of the targets
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NormalizeMethod {
    /// The body fitted to all views: the outline follows the body's occluding contour into the reference pose
    FittedBody,
    /// One skeleton for all views: from its pose in the photo to the reference pose; includes hidden bones
    #[default]
    SharedSkeleton,
    /// Each view independently, as published: directions of the avatar's bones, own lengths, visible bones only
    ThreeStep,
}

/// Input of the normalization
#[derive(Debug, Clone, Copy)]
pub struct NormalizeView<'a> {
    /// Silhouette in the photo
    pub mask: &'a Mask,
    /// The same with soft borders, 0 to 1; the half level is the outline
    pub soft: &'a Windowed<f32>,
    /// Joints as detected, in px of the photo
    pub keypoints: &'a Keypoints,
    /// The shared skeleton in this view; needed by [`NormalizeMethod::SharedSkeleton`] only
    pub skeleton: Option<&'a SkeletonJoints>,
    /// The occluding contour of the fitted body; needed by [`NormalizeMethod::FittedBody`] only
    pub outline: Option<&'a OutlineTargets>,
    /// The avatar in the reference pose, turned like this view
    pub reference: &'a ReferenceView,
}

/// The avatar in the reference pose as the camera sees it at one turn angle
#[derive(Debug, Clone)]
pub struct ReferenceView {
    /// Covered area of each pixel, 0 to 1; size of the photo
    pub coverage: Grid<f32>,
    /// Joints, in px
    pub joints: PerJoint<DVec2>,
    /// Whether enough of each bone's surface is visible; needed by [`NormalizeMethod::ThreeStep`] only
    pub visible: Option<PerBone<bool>>,
}

/// Rows of the rendering that determines visible bones: shares of their surfaces need no more
const VISIBILITY_HEIGHT_PX: f64 = 400.0;

impl ReferenceView {
    /// Renders the avatar on the turning axis, with the data that a method needs
    ///
    /// `mesh` is built from the avatar's triangles.
    pub fn render(
        avatar: &Avatar,
        mesh: &SilhouetteMesh,
        turn: TurnAngle,
        camera: &Camera,
        method: NormalizeMethod,
    ) -> Self {
        let PosedAvatar {
            bones: posed,
            positions,
        } = avatar.posed(&Pose::default(), turn);
        let visible = || {
            let scale = (VISIBILITY_HEIGHT_PX / camera.height_px as f64).min(1.0);
            visible_bones(avatar, &posed, &camera.scaled(scale))
        };
        Self {
            coverage: mesh.silhouette(&positions, camera),
            joints: shared_skeleton_joints(avatar, &Pose::default(), turn, camera).reference,
            visible: (method == NormalizeMethod::ThreeStep).then(visible),
        }
    }
}

/// Steps of the normalization and their options
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalizeOptions {
    /// Source of the targets
    pub method: NormalizeMethod,
    /// Meshing and deformation
    pub deform: DeformOptions,
    /// Options for moving the deformed silhouette onto the reference silhouette, if enabled
    pub register: Option<RegisterOptions>,
    /// Options for bending arms and legs onto the reference silhouette, if enabled
    pub refine: Option<RefineOptions>,
}

impl NormalizeOptions {
    /// The shared skeleton, without registration and refinement: both bias silhouettes toward the avatar's shape and
    /// have no benefit once the targets are consistent in 3D
    pub fn shared_skeleton() -> Self {
        Self {
            method: NormalizeMethod::SharedSkeleton,
            deform: DeformOptions::default(),
            register: None,
            refine: None,
        }
    }

    /// The fitted body, whose occluding contour provides the targets of the outline
    pub fn fitted_body() -> Self {
        Self {
            method: NormalizeMethod::FittedBody,
            ..Self::shared_skeleton()
        }
    }

    /// The published method with all three steps
    pub fn three_step() -> Self {
        Self {
            method: NormalizeMethod::ThreeStep,
            deform: DeformOptions::default(),
            register: Some(RegisterOptions::default()),
            refine: Some(RefineOptions::default()),
        }
    }
}

/// Why a view cannot be normalized
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NormalizeError {
    /// A raster differs from the mask in size
    #[error(
        "the {raster} has {width}x{height} px, the mask {mask_width}x{mask_height} px; both must have the same size"
    )]
    SizeMismatch {
        /// Name of the raster
        raster: &'static str,
        /// Its columns
        width: usize,
        /// Its rows
        height: usize,
        /// Columns of the mask
        mask_width: usize,
        /// Rows of the mask
        mask_height: usize,
    },
    /// The shared skeleton is required, but the view has none
    #[error("the view has no pose of the shared skeleton; the three-step method does not need it")]
    NoSkeleton,
    /// The fitted body is required, but missing
    #[error("the view has no fitted body; the three-step method does not need it")]
    NoFit,
    /// The three-step method is selected, but the reference was rendered for another one
    #[error("the reference view contains no bone visibility; render it for three-step")]
    NoVisibility,
    /// The silhouette cannot be deformed
    #[error(transparent)]
    Deform(#[from] DeformError),
}

/// A step that was only partially possible
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NormalizeWarning {
    /// No known joint lies inside the silhouette, so the pose of the photo is unchanged
    #[error("no joint lies inside the silhouette: its pose is unchanged")]
    NoHandles,
    /// Most of the skeleton lies outside the silhouette
    #[error("only {inside} of {all} handles lie inside the silhouette")]
    FewHandles {
        /// Number of handles inside
        inside: usize,
        /// Number of all handles
        all: usize,
    },
}

/// Joints after each step, in px; `None` where unknown
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NormalizedJoints {
    /// In the photo, as detected
    pub detected: JointPositions,
    /// Targets of the first deformation
    pub aligned: JointPositions,
    /// After registration
    pub registered: JointPositions,
    /// After refinement
    pub refined: JointPositions,
}

/// A pose-normalized silhouette
#[derive(Debug, Clone)]
pub struct NormalizedView {
    /// Size of the photo, frame of the reference view
    pub mask: Mask,
    /// Its outline, sub-pixel accurate: points with a nonzero winding number are inside
    pub contours: Vec<Contour>,
    /// Joints after each step; skipped steps repeat the previous one
    pub joints: NormalizedJoints,
    /// Result of the registration, if it ran
    pub registration: Option<Registration>,
    /// Result of the refinement for each limb that it could search
    pub limbs: Vec<LimbRefinement>,
    /// Intersection over union with the reference silhouette
    pub reference_iou: f64,
    /// Steps that were only partially possible
    pub warnings: Vec<NormalizeWarning>,
}

impl NormalizedView {
    /// Renders the silhouette as covered area of each pixel, 0 to 1
    ///
    /// Recomputed on each call: kept for all views, these would be the largest part of a result.
    pub fn soft(&self) -> Grid<f32> {
        fill_contours(self.mask.width(), self.mask.height(), &self.contours)
    }
}

/// Deforms one silhouette to the reference pose
///
/// # Errors
/// When the silhouette is empty, sizes differ, or the required skeleton or body is missing.
///
/// # Source
/// Zwettler et al. 2021: alignment (eq. 1), registration (eq. 2 to 4), refinement (eq. 5 to 7). The shared skeleton
/// is ours.
pub fn normalize(
    view: &NormalizeView<'_>,
    options: &NormalizeOptions,
) -> Result<NormalizedView, NormalizeError> {
    let (width, height) = (view.mask.width(), view.mask.height());
    let (soft, coverage) = (view.soft, &view.reference.coverage);
    check_size("soft silhouette", (soft.width(), soft.height()), view.mask)?;
    check_size(
        "reference view",
        (coverage.width(), coverage.height()),
        view.mask,
    )?;

    let detected = align::detected_joints(view.keypoints);
    let (sources, aligned) = match options.method {
        NormalizeMethod::FittedBody | NormalizeMethod::SharedSkeleton => {
            let skeleton = view.skeleton.ok_or(NormalizeError::NoSkeleton)?;
            (known(&skeleton.photo), known(&skeleton.reference))
        }
        NormalizeMethod::ThreeStep => (detected, align::align(&detected, &view.reference.joints)),
    };
    let visible = match options.method {
        NormalizeMethod::FittedBody | NormalizeMethod::SharedSkeleton => PerBone::splat(true),
        NormalizeMethod::ThreeStep => view.reference.visible.ok_or(NormalizeError::NoVisibility)?,
    };
    let spread =
        |targets: &JointPositions| -> Handles { handles(&sources, targets, |bone| visible[bone]) };
    let first = spread(&aligned);
    let contours = trace_silhouette(view.mask, view.soft, options.deform.contour);
    // Refined joints move the handles of the bones, so the outline cannot be fixed at the same time.
    let by_outline = options.method == NormalizeMethod::FittedBody && options.refine.is_none();
    let (silhouette, first) = if by_outline {
        let outline = view.outline.ok_or(NormalizeError::NoFit)?;
        let target = |position, normal| outline.target(position, normal);
        let (silhouette, targets) =
            DeformableSilhouette::by_outline(&contours, target, &options.deform)?;
        let sources = targets.clone();
        (silhouette, Handles { sources, targets })
    } else {
        let silhouette = DeformableSilhouette::new(&contours, &first.sources, &options.deform)?;
        (silhouette, first)
    };
    let mut contours = silhouette.deform(&first.targets).contours;

    let reference_map = (options.register.is_some() || options.refine.is_some())
        .then(|| ReferenceContourMap::from_coverage(&view.reference.coverage));
    let mut registration = None;
    let mut registered = aligned;
    let mut motion = RigidMotion::IDENTITY;
    if let (Some(map), Some(options)) = (&reference_map, &options.register) {
        let found = register::register(&contour_points(&contours), &aligned, map, options);
        motion = found.motion();
        registered = aligned.map(|joint| joint.map(|p| motion.apply(p)));
        move_contours(&mut contours, &motion);
        registration = Some(found);
    }
    let mut limbs = Vec::new();
    let mut refined = registered;
    if let (Some(map), Some(options)) = (&reference_map, &options.refine) {
        let found = refine::refine(&contour_points(&contours), &registered, map, options);
        refined = found.joints;
        limbs = found.limbs;
        // Deformed before the rigid motion, so that parts without handles take part in it.
        let back = motion.inverse();
        let targets: Vec<DVec2> = spread(&refined)
            .targets
            .iter()
            .map(|&p| back.apply(p))
            .collect();
        contours = silhouette.deform(&targets).contours;
        move_contours(&mut contours, &motion);
    }

    let soft = fill_contours(width, height, &contours);
    let mask = soft.threshold(0.5);
    Ok(NormalizedView {
        reference_iou: mask.iou(&view.reference.coverage.threshold(0.5)),
        mask,
        contours,
        joints: NormalizedJoints {
            detected,
            aligned,
            registered,
            refined,
        },
        registration,
        limbs,
        warnings: handle_warning(silhouette.handle_count(), first.sources.len())
            .into_iter()
            .collect(),
    })
}

fn check_size(
    raster: &'static str,
    (width, height): (usize, usize),
    mask: &Mask,
) -> Result<(), NormalizeError> {
    if (width, height) == (mask.width(), mask.height()) {
        return Ok(());
    }
    Err(NormalizeError::SizeMismatch {
        raster,
        width,
        height,
        mask_width: mask.width(),
        mask_height: mask.height(),
    })
}

/// Returns all joints except those that the camera cannot see
fn known(joints: &PerJoint<DVec2>) -> JointPositions {
    joints.map(|p| p.is_finite().then_some(p))
}

/// Samples evenly spaced points of all contours
fn contour_points(contours: &[Contour]) -> Vec<DVec2> {
    contours
        .iter()
        .flat_map(|contour| contour.resample(CONTOUR_SPACING_PX).points)
        .collect()
}

fn move_contours(contours: &mut [Contour], motion: &RigidMotion) {
    for point in contours.iter_mut().flat_map(|c| &mut c.points) {
        *point = motion.apply(*point);
    }
}

/// Silhouettes with fewer than half of the handles inside hardly match the joints
fn handle_warning(inside: usize, all: usize) -> Option<NormalizeWarning> {
    if inside == 0 {
        Some(NormalizeWarning::NoHandles)
    } else if 2 * inside < all {
        Some(NormalizeWarning::FewHandles { inside, all })
    } else {
        None
    }
}

#[cfg(test)]
mod tests;
