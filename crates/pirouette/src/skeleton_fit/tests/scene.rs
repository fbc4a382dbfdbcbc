//! A simple body with known truth, seen by known cameras.

use glam::{DVec2, DVec3};
use pirouette_geom::TriMesh;

use super::super::*;
use crate::scan::STATED_TURN_SD_DEGREES;
use pirouette_body::{Keypoint, PerBone, PerJoint, ReferencePose, SkinWeight};

pub(super) const STATURE_MM: f64 = 1700.0;

pub(super) fn mirrored(p: DVec3) -> DVec3 {
    DVec3::new(-p.x, p.y, p.z)
}

/// Bone heads in the A-pose
pub(super) fn heads() -> PerBone<DVec3> {
    let mut heads = PerBone::splat(DVec3::ZERO);
    for (bone, head) in [
        (Bone::Root, [0.0, 930.0, -10.0]),
        (Bone::LowerSpine, [0.0, 960.0, 0.0]),
        (Bone::UpperSpine, [0.0, 1160.0, -10.0]),
        (Bone::Neck, [0.0, 1440.0, 0.0]),
        (Bone::Head, [0.0, 1530.0, 20.0]),
        (Bone::LeftClavicle, [30.0, 1400.0, 10.0]),
        (Bone::LeftUpperArm, [180.0, 1390.0, -10.0]),
        (Bone::LeftForearm, [370.0, 1200.0, -15.0]),
        (Bone::LeftHand, [540.0, 1030.0, 10.0]),
        (Bone::LeftThigh, [95.0, 900.0, 0.0]),
        (Bone::LeftShin, [130.0, 490.0, 10.0]),
        (Bone::LeftFoot, [160.0, 80.0, -20.0]),
    ] {
        heads[bone] = DVec3::from_array(head);
        if bone.mirrored() != bone {
            heads[bone.mirrored()] = mirrored(DVec3::from_array(head));
        }
    }
    heads
}

/// A body of boxes around the bones: sufficient for crown, soles and bone lengths
pub(super) fn body() -> Avatar {
    let heads = heads();
    let head = |bone: Bone| heads[bone];
    let mut keypoints = PerJoint::splat(DVec3::ZERO);
    for (joint, point) in [
        (Joint::Nose, DVec3::new(0.0, 1570.0, 120.0)),
        (Joint::LeftEye, DVec3::new(32.0, 1600.0, 100.0)),
        (Joint::LeftEar, DVec3::new(75.0, 1580.0, 20.0)),
        (Joint::LeftShoulder, head(Bone::LeftUpperArm)),
        (Joint::LeftElbow, head(Bone::LeftForearm)),
        (Joint::LeftWrist, head(Bone::LeftHand)),
        (Joint::LeftHip, head(Bone::LeftThigh)),
        (Joint::LeftKnee, head(Bone::LeftShin)),
        (Joint::LeftAnkle, head(Bone::LeftFoot)),
        (Joint::LeftBigToe, DVec3::new(180.0, 20.0, 160.0)),
        (Joint::LeftSmallToe, DVec3::new(230.0, 20.0, 120.0)),
        (Joint::LeftHeel, DVec3::new(155.0, 30.0, -70.0)),
    ] {
        keypoints[joint] = point;
        if joint.mirrored() != joint {
            keypoints[joint.mirrored()] = mirrored(point);
        }
    }
    keypoints[Joint::Neck] = DVec3::new(0.0, 1390.0, -10.0);
    keypoints[Joint::MidHip] = DVec3::new(0.0, 900.0, 0.0);

    let (mut positions, mut weights, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
    for bone in Bone::ALL {
        let low = match bone {
            Bone::Head => DVec3::new(0.0, 1600.0, 20.0),
            Bone::LeftFoot | Bone::RightFoot => head(bone) * DVec3::new(1.0, 0.5, 1.0),
            _ => head(bone),
        };
        let size = match bone {
            Bone::Head => DVec3::new(70.0, 100.0, 90.0),
            Bone::LeftFoot | Bone::RightFoot => DVec3::new(40.0, 40.0, 90.0),
            _ => DVec3::splat(30.0),
        };
        let first = positions.len() as u32;
        for corner in 0..8 {
            let sign = |bit: u32| if corner >> bit & 1 == 1 { 1.0 } else { -1.0 };
            positions.push(low + size * DVec3::new(sign(0), sign(1), sign(2)));
            weights.push(SkinWeight::rigid(bone));
        }
        triangles.push([first, first + 1, first + 2]);
    }
    Avatar {
        mesh: TriMesh {
            positions,
            triangles,
        },
        weights,
        bone_heads: heads,
        keypoints,
        pose: ReferencePose::A,
    }
}

/// Reproducible noise: sums of twelve uniform numbers are sufficiently normal
pub(super) struct Noise(pub(super) u64);

impl Noise {
    pub(super) fn uniform(&mut self) -> f64 {
        // SplitMix64, Steele et al. 2014
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(super) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// A scan with its truth
#[derive(Clone)]
pub(super) struct Truth {
    pub(super) body: Avatar,
    pub(super) camera: Camera,
    pub(super) poses: Vec<Pose>,
    pub(super) views: Vec<KeypointView>,
}

pub(super) struct Setting {
    pub(super) turns: Vec<f64>,
    /// Sway in prior standard deviations
    pub(super) sway: f64,
    pub(super) noise_px: f64,
    pub(super) seed: u64,
    pub(super) pitch_radians: f64,
    /// Rotation of both forearms about x in all views: straighter or more bent than in the reference pose
    pub(super) forearms_degrees: f64,
}

impl Default for Setting {
    fn default() -> Self {
        Self {
            turns: (0..8).map(|i| 45.0 * f64::from(i)).collect(),
            sway: 0.5,
            noise_px: 0.0,
            seed: 1,
            pitch_radians: 0.0,
            forearms_degrees: 0.0,
        }
    }
}

pub(super) fn scales() -> BoneScales {
    BoneScales {
        logs: [0.03, -0.04, 0.03, 0.02, -0.03, -0.03, -0.01, 0.02, 0.03],
    }
}

pub(super) fn scan(setting: &Setting) -> Truth {
    let scaled = rescale_avatar(&body(), &scales());
    let body = scaled.clone().scaled(STATURE_MM / scaled.stature_mm());
    let camera = Camera {
        width_px: 800,
        height_px: 1000,
        vertical_fov_radians: 0.85,
        height_mm: 900.0,
        distance_mm: 2400.0,
        pitch_radians: setting.pitch_radians,
        yaw_radians: 0.0,
        distortion: 0.0,
    };
    let mut noise = Noise(setting.seed);
    let sigmas = Pose::prior_sigmas();
    let mut poses = Vec::new();
    let mut views = Vec::new();
    for &degrees in &setting.turns {
        let mut parameters = sigmas.map(|sigma| sigma * noise.normal() * setting.sway);
        parameters[3 * Bone::COUNT + 1] = 0.0; // feet stay on the floor
        let mut pose = Pose::from_parameters(&parameters);
        for bone in [Bone::LeftForearm, Bone::RightForearm] {
            pose.rotations[bone].x += setting.forearms_degrees.to_radians();
        }
        let turn = TurnAngle::from_degrees(degrees);
        let posed = pose_bones(&body.bone_heads, &pose, turn);
        let mut keypoints = Keypoints::default();
        for (joint, point) in Joint::ALL.iter().zip(room_joints(&posed, &body.keypoints)) {
            let error = DVec2::new(noise.normal(), noise.normal()) * setting.noise_px;
            let keypoint = Keypoint {
                position: camera.project(point) + error,
                confidence: 0.9,
            };
            keypoints.set(*joint, keypoint);
        }
        poses.push(pose);
        views.push(KeypointView {
            turn,
            turn_sd_radians: STATED_TURN_SD_DEGREES.to_radians(),
            time_s: None,
            keypoints,
            keypoint_kind: KeypointKind::default(),
            width_px: camera.width_px,
            height_px: camera.height_px,
        });
    }
    Truth {
        body,
        camera,
        poses,
        views,
    }
}

pub(super) fn setup(camera: &Camera) -> CameraSetup {
    CameraSetup {
        vertical_fov_radians: Some(camera.vertical_fov_radians),
        height_mm: Some(camera.height_mm),
        distance_mm: None,
        pitch_radians: None,
        yaw_radians: None,
        distortion: 0.0,
    }
}

/// A skeleton with its views
#[derive(Debug)]
pub(super) struct Solved {
    pub(super) skeleton: Skeleton,
    pub(super) views: Vec<SkeletonView>,
}

impl From<(Skeleton, Vec<SkeletonView>)> for Solved {
    fn from((skeleton, views): (Skeleton, Vec<SkeletonView>)) -> Self {
        Self { skeleton, views }
    }
}

pub(super) fn solved(truth: &Truth) -> Solved {
    let found = fit_skeleton(
        &body(),
        &truth.views,
        &setup(&truth.camera),
        Some(STATURE_MM),
        &SkeletonFitOptions::default(),
    )
    .expect("a good scan");
    found.into()
}

/// Returns the root mean square distance of the joints from their true positions, including the root shift, in mm
pub(super) fn joint_error_mm(truth: &Truth, found: &Solved) -> f64 {
    let mut sum = 0.0;
    for (view, pose) in truth.poses.iter().enumerate() {
        let posed = pose_bones(&truth.body.bone_heads, pose, truth.views[view].turn);
        let joints = room_joints(&posed, &truth.body.keypoints);
        for (a, b) in joints
            .iter()
            .zip(found.views[view].joints(&found.skeleton.avatar))
        {
            sum += (*a - b).length_squared();
        }
    }
    (sum / (truth.poses.len() * Joint::COUNT) as f64).sqrt()
}
