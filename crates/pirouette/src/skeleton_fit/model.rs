//! Predicted keypoints of each photo, and their derivatives.
//!
//! All unknowns are in units of their prior standard deviations: the prior of each is a unit normal distribution, and
//! an unknown with a standard deviation of zero is fixed at its start.

use faer::Mat;
use glam::{DVec2, DVec3};

use super::Tracked;
use super::scales::{BoneScale, BoneScales, Frame, ScaledFrame};
use super::start::FREE_TURN_SIGMA_RADIANS;
use pirouette_body::{
    Bone, Camera, Joint, Motion, PerBone, PerJoint, Pose, PosedBones, TurnAngle, pose_bones,
};

/// Unknowns of one view
pub(super) const POSE_COUNT: usize = Pose::PARAMETER_COUNT;

/// Index of the turn of the root, in the unknowns of one view
pub(super) const TURN: usize = Pose::first_parameter(Bone::Root) + 1;

/// Unknowns shared by all views: scales, offsets, camera, posture
pub(super) const SHARED_COUNT: usize = POSTURE_START + 3 * POSTURE_BONES.len();
const OFFSET_START: usize = BoneScale::COUNT;
const CAMERA_START: usize = OFFSET_START + 3 * OFFSET_JOINTS.len();
const POSTURE_START: usize = CAMERA_START + 4;

/// Bones whose posture may differ from the reference pose in all views, with the prior standard deviation of each
/// coordinate of that rotation, in degrees
///
/// People asked to stretch their arms out hold them higher or lower, and straight or bent; the sway between views is
/// far smaller.
const POSTURE_BONES: [(Bone, f64); 6] = [
    (Bone::LeftUpperArm, 12.0),
    (Bone::RightUpperArm, 12.0),
    (Bone::LeftForearm, 25.0),
    (Bone::RightForearm, 25.0),
    (Bone::LeftThigh, 5.0),
    (Bone::RightThigh, 5.0),
];

/// Points of face and feet whose position on the bone varies between persons and between detectors
const OFFSET_JOINTS: [Joint; 11] = [
    Joint::Nose,
    Joint::RightEye,
    Joint::LeftEye,
    Joint::RightEar,
    Joint::LeftEar,
    Joint::LeftBigToe,
    Joint::LeftSmallToe,
    Joint::LeftHeel,
    Joint::RightBigToe,
    Joint::RightSmallToe,
    Joint::RightHeel,
];

/// Prior standard deviation of the logarithm of a bone length
///
/// Bodies of one stature vary by about this much; larger values let views from one side trade bone lengths for poses.
const SCALE_SIGMA: f64 = 0.06;

/// Prior standard deviation of each coordinate of a face or foot point on its bone, in mm
pub(super) const OFFSET_SIGMA_MM: f64 = 15.0;

/// The same for keypoints of [`crate::detect`], whose positions on the body are known
pub(super) const DETECTED_OFFSET_SIGMA_MM: f64 = 8.0;

/// Standard deviation of the body's height around the given stature, in mm
///
/// Not smaller, because hair, shoes and posture are in the photos but not in the given value.
const STATURE_SIGMA_MM: f64 = 6.0;

/// Start values and prior standard deviations of the camera's unknowns
#[derive(Debug, Clone, Copy)]
pub(super) struct CameraPrior {
    pub(super) distance_mm: (f64, f64),
    pub(super) height_mm: (f64, f64),
    pub(super) pitch_radians: (f64, f64),
    pub(super) yaw_radians: f64,
    pub(super) distortion: f64,
    pub(super) vertical_fov_radians: f64,
    /// Of the logarithm of the focal length, which starts at the value of the field of view
    pub(super) log_focal_sigma: f64,
}

/// A keypoint with its uncertainty
#[derive(Debug, Clone, Copy)]
pub(super) struct Observed {
    pub(super) position: DVec2,
    pub(super) sigma_px: f64,
}

/// Known data of one view
#[derive(Debug, Clone)]
pub(super) struct ViewData {
    pub(super) turn: TurnAngle,
    /// Prior standard deviation of the turn of the pose beyond `turn`
    pub(super) turn_sigma_radians: f64,
    pub(super) tracked: Option<Tracked>,
    pub(super) width_px: usize,
    pub(super) height_px: usize,
    pub(super) observed: PerJoint<Option<Observed>>,
    /// Whether the face certainly is seen, or certainly is not
    pub(super) face_seen: Option<bool>,
}

impl ViewData {
    pub(super) fn observed_count(&self) -> usize {
        self.observed.iter().flatten().count()
    }

    /// Returns the prior standard deviations of the pose
    fn pose_sigmas(&self) -> [f64; POSE_COUNT] {
        let mut sigmas = if self.is_free() {
            Pose::stepping_sigmas()
        } else {
            Pose::prior_sigmas()
        };
        sigmas[TURN] = self.turn_sigma_radians;
        sigmas
    }

    /// Returns whether the turn of the pose is not held by a stated angle
    fn is_free(&self) -> bool {
        self.turn_sigma_radians >= FREE_TURN_SIGMA_RADIANS
    }

    /// Frees the turn of a pose from the angle; no predicted keypoint moves
    pub(super) fn free_turn(&mut self, unknowns: &mut [f64; POSE_COUNT]) {
        let before = self.pose_sigmas();
        self.turn_sigma_radians = FREE_TURN_SIGMA_RADIANS;
        let sigmas = before.into_iter().zip(self.pose_sigmas());
        for (unknown, (before, now)) in unknowns.iter_mut().zip(sigmas) {
            *unknown *= before / now;
        }
    }

    /// Moves the turn of a pose into the turn angle, except for `rest`; no predicted keypoint moves
    pub(super) fn center_turn(&mut self, unknowns: &mut [f64; POSE_COUNT], rest: f64) {
        let sigmas = self.pose_sigmas();
        let root = Pose::first_parameter(Bone::Root);
        let mut pose = Pose::from_parameters(&std::array::from_fn(|i| unknowns[i] * sigmas[i]));
        let moved = pose.turned_more().radians() - rest;
        let turn = TurnAngle::from_radians(self.turn.radians() + moved);
        pose = pose.about_turn(self.turn, turn);
        for (k, radians) in pose.rotations[Bone::Root]
            .to_array()
            .into_iter()
            .enumerate()
        {
            unknowns[root + k] = radians / sigmas[root + k];
        }
        self.turn = turn;
    }
}

/// Constants of the fit
#[derive(Debug, Clone)]
pub(super) struct Problem {
    pub(super) frame: Frame,
    pub(super) stature_mm: f64,
    pub(super) camera: CameraPrior,
    /// Prior standard deviation of each coordinate of a face or foot point on its bone, in mm
    pub(super) offset_sigma_mm: f64,
    /// Distance of the camera by the person's size in the photos, in mm
    pub(super) seen_distance_mm: f64,
    /// Whether a posture is solved for; otherwise all rotations are sway
    pub(super) free_posture: bool,
    pub(super) views: Vec<ViewData>,
}

/// The unknowns of all views, in units of their prior standard deviations
#[derive(Debug, Clone)]
pub(super) struct Unknowns {
    pub(super) shared: [f64; SHARED_COUNT],
    pub(super) poses: Vec<[f64; POSE_COUNT]>,
}

/// Body and camera for given shared unknowns
#[derive(Debug, Clone)]
pub(super) struct Shared {
    pub(super) scales: BoneScales,
    pub(super) offsets: [DVec3; OFFSET_JOINTS.len()],
    pub(super) body: ScaledFrame,
    /// Posture: common rotations in all views
    pub(super) posture: Pose,
    camera: Camera,
}

/// Normal equations of one view, without priors
///
/// Row and column order: pose, shared unknowns (if requested), residual; the last column is the gradient.
#[derive(Debug)]
pub(super) struct Normal {
    pub(super) matrix: Mat<f64>,
}

/// Returns Cauchy's robust loss of a squared residual, in standard deviations
///
/// Half the square far below `width`, logarithmic beyond.
pub(super) fn robust_loss(residual_squared: f64, width: f64) -> f64 {
    let c2 = width * width;
    c2 / 2.0 * (residual_squared / c2).ln_1p()
}

impl Problem {
    /// Number of shared unknowns to solve for; the posture comes last
    pub(super) fn shared_count(&self) -> usize {
        if self.free_posture {
            SHARED_COUNT
        } else {
            POSTURE_START
        }
    }

    pub(super) fn shared_sigmas(&self) -> [f64; SHARED_COUNT] {
        let mut sigmas = [SCALE_SIGMA; SHARED_COUNT];
        sigmas[OFFSET_START..CAMERA_START].fill(self.offset_sigma_mm);
        let camera = &self.camera;
        sigmas[CAMERA_START..POSTURE_START].copy_from_slice(&[
            camera.distance_mm.1,
            camera.height_mm.1,
            camera.pitch_radians.1,
            camera.log_focal_sigma,
        ]);
        let posture = sigmas[POSTURE_START..].chunks_exact_mut(3);
        for (slots, (_, degrees)) in posture.zip(POSTURE_BONES) {
            slots.fill(if self.free_posture {
                degrees.to_radians()
            } else {
                0.0
            });
        }
        sigmas
    }

    pub(super) fn start(&self) -> Unknowns {
        Unknowns {
            shared: [0.0; SHARED_COUNT],
            poses: vec![[0.0; POSE_COUNT]; self.views.len()],
        }
    }

    /// Returns body and camera for given shared unknowns
    pub(super) fn shared(&self, unknowns: &[f64; SHARED_COUNT]) -> Shared {
        let sigmas = self.shared_sigmas();
        let values: [f64; SHARED_COUNT] = std::array::from_fn(|i| unknowns[i] * sigmas[i]);
        let scales = BoneScales {
            logs: std::array::from_fn(|i| values[i]),
        };
        let offsets: [DVec3; OFFSET_JOINTS.len()] =
            std::array::from_fn(|i| DVec3::from_slice(&values[OFFSET_START + 3 * i..]));
        let mut body = self.frame.scaled(&scales);
        for (joint, offset) in OFFSET_JOINTS.iter().zip(offsets) {
            body.keypoints[*joint] += offset;
        }
        let mut posture = Pose::default();
        for (v, (bone, _)) in values[POSTURE_START..].chunks_exact(3).zip(POSTURE_BONES) {
            posture.rotations[bone] = DVec3::from_slice(v);
        }
        let prior = &self.camera;
        let focal = values[CAMERA_START + 3].exp() / (prior.vertical_fov_radians / 2.0).tan();
        Shared {
            scales,
            offsets,
            body,
            posture,
            camera: Camera {
                width_px: 0,
                height_px: 0,
                vertical_fov_radians: 2.0 * (1.0 / focal).atan(),
                height_mm: prior.height_mm.0 + values[CAMERA_START + 1],
                distance_mm: prior.distance_mm.0 + values[CAMERA_START],
                pitch_radians: prior.pitch_radians.0 + values[CAMERA_START + 2],
                yaw_radians: prior.yaw_radians,
                distortion: prior.distortion,
            },
        }
    }

    /// Returns the cost of the shared unknowns alone: their priors and the stature
    pub(super) fn shared_cost(&self, unknowns: &[f64; SHARED_COUNT], shared: &Shared) -> f64 {
        let stature = self.stature_residual(shared);
        half_square(unknowns) + stature * stature / 2.0
    }

    /// Returns the difference of the body's height from the stature, in standard deviations
    pub(super) fn stature_residual(&self, shared: &Shared) -> f64 {
        (shared.body.stature_mm - self.stature_mm) / STATURE_SIGMA_MM
    }

    /// Returns the gradient of [`Problem::stature_residual`] by the shared unknowns
    pub(super) fn stature_gradient(&self, rates: &[ScaledFrame]) -> [f64; SHARED_COUNT] {
        let mut gradient = [0.0; SHARED_COUNT];
        for (slot, rate) in gradient.iter_mut().zip(rates) {
            *slot = rate.stature_mm * SCALE_SIGMA / STATURE_SIGMA_MM;
        }
        gradient
    }

    /// Returns the derivatives of the body by each logarithmic scale
    pub(super) fn body_rates(&self, shared: &Shared) -> Vec<ScaledFrame> {
        BoneScale::ALL
            .iter()
            .map(|&scale| self.frame.rate(&shared.scales, scale))
            .collect()
    }

    /// Returns the cost of one view, keypoints and pose prior; infinite when the body is too close to the camera
    pub(super) fn view_cost(
        &self,
        view: &ViewData,
        shared: &Shared,
        pose: &[f64; POSE_COUNT],
        width: f64,
    ) -> f64 {
        let Some(residuals) = self.residuals(view, shared, pose) else {
            return f64::INFINITY;
        };
        let data: f64 = residuals
            .iter()
            .flatten()
            .map(|r| robust_loss(r.length_squared(), width))
            .sum();
        data + half_square(pose)
    }

    /// Returns predicted minus detected joints, in standard deviations; `None` when the body is too close to the camera
    pub(super) fn residuals(
        &self,
        view: &ViewData,
        shared: &Shared,
        pose: &[f64; POSE_COUNT],
    ) -> Option<PerJoint<Option<DVec2>>> {
        let posed = pose_bones(&shared.body.heads, &shared.pose(view, pose), view.turn);
        let camera = shared.camera_of(view);
        let joints = room_joints(&posed, &shared.body.keypoints);
        let mut residuals = PerJoint::splat(None);
        for ((slot, observed), &joint) in residuals.iter_mut().zip(&view.observed).zip(&joints) {
            if camera.depth(joint) < MIN_DEPTH_MM {
                return None;
            }
            *slot = observed.map(|o| (camera.project(joint) - o.position) / o.sigma_px);
        }
        Some(residuals)
    }

    /// Returns the normal equations of one view; without `rates` of the body, the shared unknowns are held constant
    pub(super) fn normal(
        &self,
        view: &ViewData,
        shared: &Shared,
        rates: Option<&[ScaledFrame]>,
        pose: &[f64; POSE_COUNT],
        width: f64,
    ) -> Normal {
        let posed = pose_bones(&shared.body.heads, &shared.pose(view, pose), view.turn);
        let joints = room_joints(&posed, &shared.body.keypoints);
        let camera = shared.camera_of(view);
        let jacobian = Jacobian {
            pose_sigmas: view.pose_sigmas(),
            shared_sigmas: self.shared_sigmas(),
            motions: std::array::from_fn(|parameter| posed.motion(parameter)),
            shifts: rates.map(|rates| {
                rates
                    .iter()
                    .map(|rate| transform_rates(&posed, rate))
                    .collect()
            }),
            rates,
            free_posture: self.free_posture && rates.is_some(),
            posed: &posed,
            joints: &joints,
        };
        let columns = POSE_COUNT + rates.map_or(0, |_| self.shared_count()) + 1;
        let mut rows = Mat::<f64>::zeros(2 * view.observed_count(), columns);
        let mut row = 0;
        for joint in Joint::ALL {
            let Some(observed) = view.observed[joint] else {
                continue;
            };
            let point = joints[joint];
            let residual = (camera.project(point) - observed.position) / observed.sigma_px;
            let weight = (1.0 + residual.length_squared() / (width * width))
                .sqrt()
                .recip();
            let scale = weight / observed.sigma_px;
            let gradients = camera.project_gradients(point).map(|g| g * scale);
            for (part, share) in joint.parts() {
                jacobian.add(&mut rows, row, part, gradients, share);
            }
            if rates.is_some() {
                jacobian.add_camera(&mut rows, row, &camera, point, scale);
            }
            rows[(row, columns - 1)] = residual.x * weight;
            rows[(row + 1, columns - 1)] = residual.y * weight;
            row += 2;
        }
        Normal {
            matrix: rows.transpose() * &rows,
        }
    }
}

/// Minimum distance of the body from the camera, in mm
const MIN_DEPTH_MM: f64 = 100.0;

fn half_square(unknowns: &[f64]) -> f64 {
    unknowns.iter().map(|x| x * x).sum::<f64>() / 2.0
}

/// Returns the keypoints of the posed body in the room
pub(super) fn room_joints(posed: &PosedBones, keypoints: &PerJoint<DVec3>) -> PerJoint<DVec3> {
    let carry = |joint: Joint| posed.carry(joint.bone(), keypoints[joint]);
    PerJoint::from_fn(|joint| joint.parts().map(|(part, share)| carry(part) * share).sum())
}

/// Returns the derivatives of the bones' translations, given those of the bone heads
///
/// From `x = T_parent(head + R (p - head))` with constant rotations: the derivative of each head is transformed by the
/// rotations of the parent and of the bone.
fn transform_rates(posed: &PosedBones, rate: &ScaledFrame) -> PerBone<DVec3> {
    let mut shifts = PerBone::splat(DVec3::ZERO);
    for bone in Bone::ALL {
        if let Some(parent) = bone.parent() {
            let head = rate.heads[bone];
            let [of_bone, of_parent] = [bone, parent].map(|i| posed.transforms[i].matrix3 * head);
            shifts[bone] = shifts[parent] + of_parent - of_bone;
        }
    }
    shifts
}

impl Shared {
    /// Returns the pose of one view: posture and the sway given by its unknowns
    pub(super) fn pose(&self, view: &ViewData, unknowns: &[f64; POSE_COUNT]) -> Pose {
        let sigmas = view.pose_sigmas();
        let posture = self.posture.to_parameters();
        Pose::from_parameters(&std::array::from_fn(|i| {
            posture[i] + unknowns[i] * sigmas[i]
        }))
    }

    /// Returns the offset of each keypoint from its stretched position, in the reference pose
    pub(super) fn keypoint_offsets(&self) -> PerJoint<DVec3> {
        let mut offsets = PerJoint::splat(DVec3::ZERO);
        for (joint, offset) in OFFSET_JOINTS.iter().zip(self.offsets) {
            offsets[*joint] = offset;
        }
        offsets
    }

    /// Returns the camera of one view
    pub(super) fn camera_of(&self, view: &ViewData) -> Camera {
        Camera {
            width_px: view.width_px,
            height_px: view.height_px,
            ..self.camera
        }
    }
}

/// Writes rows of the Jacobian of one view
struct Jacobian<'a> {
    pose_sigmas: [f64; POSE_COUNT],
    shared_sigmas: [f64; SHARED_COUNT],
    motions: [Motion; POSE_COUNT],
    /// Derivatives of the bones' translations by each scale
    shifts: Option<Vec<PerBone<DVec3>>>,
    rates: Option<&'a [ScaledFrame]>,
    free_posture: bool,
    posed: &'a PosedBones,
    joints: &'a PerJoint<DVec3>,
}

impl Jacobian<'_> {
    /// Adds `share` times the derivatives of one joint to two rows; `gradients` of the rows by the room point
    fn add(
        &self,
        rows: &mut Mat<f64>,
        row: usize,
        joint: Joint,
        gradients: [DVec3; 2],
        share: f64,
    ) {
        let mut put = |column: usize, velocity: DVec3| {
            for (i, gradient) in gradients.iter().enumerate() {
                rows[(row + i, column)] += gradient.dot(velocity) * share;
            }
        };
        let bone = joint.bone();
        let point = self.joints[joint];
        let mut ancestor = Some(bone);
        while let Some(moving) = ancestor {
            let posture = POSTURE_BONES.iter().position(|&(bone, _)| bone == moving);
            for k in 0..3 {
                let parameter = Pose::first_parameter(moving) + k;
                let velocity = self.motions[parameter].velocity(point);
                put(parameter, velocity * self.pose_sigmas[parameter]);
                if let (Some(posture), true) = (posture, self.free_posture) {
                    let i = POSTURE_START + 3 * posture + k;
                    put(POSE_COUNT + i, velocity * self.shared_sigmas[i]);
                }
            }
            ancestor = moving.parent();
        }
        for parameter in 3 * Bone::COUNT..POSE_COUNT {
            let velocity = self.motions[parameter].velocity(point);
            put(parameter, velocity * self.pose_sigmas[parameter]);
        }
        let (Some(rates), Some(shifts)) = (self.rates, &self.shifts) else {
            return;
        };
        let rotation = self.posed.transforms[bone].matrix3;
        for (i, (rate, shift)) in rates.iter().zip(shifts).enumerate() {
            let velocity = rotation * rate.keypoints[joint] + shift[bone];
            put(POSE_COUNT + i, velocity * self.shared_sigmas[i]);
        }
        if let Some(offset) = OFFSET_JOINTS.iter().position(|&j| j == joint) {
            for (k, axis) in [rotation.x_axis, rotation.y_axis, rotation.z_axis]
                .into_iter()
                .enumerate()
            {
                let i = OFFSET_START + 3 * offset + k;
                put(POSE_COUNT + i, axis * self.shared_sigmas[i]);
            }
        }
    }

    /// Writes the derivatives of one joint by distance, height, pitch and logarithm of the focal length
    fn add_camera(
        &self,
        rows: &mut Mat<f64>,
        row: usize,
        camera: &Camera,
        point: DVec3,
        scale: f64,
    ) {
        let [to_x, to_y] = camera.project_gradients(point);
        let view = camera.view_from_room(point);
        let (x, y) = (view.x / view.z, view.y / view.z);
        let bend = camera.lens_gradient(point) * camera.focal_px();
        let rates = [
            DVec2::new(-to_x.z, -to_y.z),
            DVec2::new(-to_x.y, -to_y.y),
            bend * DVec2::new(-x * y, -(1.0 + y * y)),
            bend * DVec2::new(x, y),
        ];
        for (i, rate) in rates.into_iter().enumerate() {
            let column = POSE_COUNT + CAMERA_START + i;
            let unit = self.shared_sigmas[CAMERA_START + i] * scale;
            rows[(row, column)] = rate.x * unit;
            rows[(row + 1, column)] = rate.y * unit;
        }
    }
}
