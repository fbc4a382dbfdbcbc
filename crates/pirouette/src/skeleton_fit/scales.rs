//! Bone lengths of one person: nine scales that stretch the avatar along its bones.
//!
//! Every bone stretches its attached points relative to its own head: the heads of its children, its keypoints and,
//! blended by the skinning weights, the surface. The trunk is stretched along y by the torso and along x by the
//! shoulders or the hips; arms and legs are stretched along themselves; hands keep their size.

use glam::{DMat3, DVec3};

use pirouette_body::{Avatar, Bone, PerBone, PerJoint, SkinWeight};

/// An estimated length of the body; left and right limbs share it
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
#[allow(missing_docs, reason = "the names say it")]
pub enum BoneScale {
    Torso,
    ShoulderWidth,
    HipWidth,
    UpperArm,
    Forearm,
    Thigh,
    Shin,
    /// Neck and head, upward
    Neck,
    /// Foot, forward
    Foot,
}

impl BoneScale {
    /// Number of scales
    pub const COUNT: usize = 9;

    /// All scales
    pub const ALL: [BoneScale; BoneScale::COUNT] = [
        BoneScale::Torso,
        BoneScale::ShoulderWidth,
        BoneScale::HipWidth,
        BoneScale::UpperArm,
        BoneScale::Forearm,
        BoneScale::Thigh,
        BoneScale::Shin,
        BoneScale::Neck,
        BoneScale::Foot,
    ];

    /// Returns the name in files, in snake case
    pub fn name(self) -> &'static str {
        match self {
            BoneScale::Torso => "torso",
            BoneScale::ShoulderWidth => "shoulder_width",
            BoneScale::HipWidth => "hip_width",
            BoneScale::UpperArm => "upper_arm",
            BoneScale::Forearm => "forearm",
            BoneScale::Thigh => "thigh",
            BoneScale::Shin => "shin",
            BoneScale::Neck => "neck",
            BoneScale::Foot => "foot",
        }
    }
}

/// Natural logarithms of the nine scales; zero is the avatar
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BoneScales {
    /// In the order of [`BoneScale::ALL`]
    pub logs: [f64; BoneScale::COUNT],
}

impl BoneScales {
    /// Returns the factor of one length
    pub fn factor(&self, scale: BoneScale) -> f64 {
        self.logs[scale as usize].exp()
    }
}

/// The linear map of one bone: identity plus `(factor - 1)` times a projection per scale
#[derive(Debug, Clone, Copy)]
struct Stretch {
    parts: [Option<(BoneScale, DMat3)>; 2],
}

impl Stretch {
    fn of(bone: Bone, heads: &PerBone<DVec3>) -> Self {
        let x = DMat3::from_diagonal(DVec3::X);
        let y = DMat3::from_diagonal(DVec3::Y);
        let z = DMat3::from_diagonal(DVec3::Z);
        let along = |child: Bone| {
            let d = (heads[child] - heads[bone]).normalize_or_zero();
            DMat3::from_cols(d * d.x, d * d.y, d * d.z)
        };
        let parts = match bone {
            Bone::Root | Bone::LowerSpine => {
                [Some((BoneScale::HipWidth, x)), Some((BoneScale::Torso, y))]
            }
            Bone::UpperSpine | Bone::LeftClavicle | Bone::RightClavicle => [
                Some((BoneScale::ShoulderWidth, x)),
                Some((BoneScale::Torso, y)),
            ],
            Bone::Neck | Bone::Head => [Some((BoneScale::Neck, y)), None],
            Bone::LeftUpperArm => [Some((BoneScale::UpperArm, along(Bone::LeftForearm))), None],
            Bone::RightUpperArm => [Some((BoneScale::UpperArm, along(Bone::RightForearm))), None],
            Bone::LeftForearm => [Some((BoneScale::Forearm, along(Bone::LeftHand))), None],
            Bone::RightForearm => [Some((BoneScale::Forearm, along(Bone::RightHand))), None],
            Bone::LeftHand | Bone::RightHand => [None, None],
            Bone::LeftThigh => [Some((BoneScale::Thigh, along(Bone::LeftShin))), None],
            Bone::RightThigh => [Some((BoneScale::Thigh, along(Bone::RightShin))), None],
            Bone::LeftShin => [Some((BoneScale::Shin, along(Bone::LeftFoot))), None],
            Bone::RightShin => [Some((BoneScale::Shin, along(Bone::RightFoot))), None],
            Bone::LeftFoot | Bone::RightFoot => [Some((BoneScale::Foot, z)), None],
        };
        Self { parts }
    }

    fn matrix(&self, scales: &BoneScales) -> DMat3 {
        self.parts
            .iter()
            .flatten()
            .fold(DMat3::IDENTITY, |sum, &(scale, projection)| {
                sum + projection * (scales.factor(scale) - 1.0)
            })
    }

    fn rate(&self, scales: &BoneScales, by: BoneScale) -> DMat3 {
        self.parts
            .iter()
            .flatten()
            .filter(|part| part.0 == by)
            .fold(DMat3::ZERO, |sum, &(scale, projection)| {
                sum + projection * scales.factor(scale)
            })
    }
}

/// Points moved by the scales: bone heads, keypoints, and one vertex each of the crown and of the soles
///
/// The crown vertex and the sole vertex define stature and floor while the scales are solved for; the final surface is
/// put on the floor by its own lowest vertex.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    heads: PerBone<DVec3>,
    keypoints: PerJoint<DVec3>,
    stretches: PerBone<Stretch>,
    crown: (DVec3, SkinWeight),
    sole: (DVec3, SkinWeight),
}

/// The avatar's frame with scales applied, on the floor, with the turning axis of the avatar
#[derive(Debug, Clone)]
pub(super) struct ScaledFrame {
    pub(super) heads: PerBone<DVec3>,
    pub(super) keypoints: PerJoint<DVec3>,
    pub(super) stature_mm: f64,
}

impl Frame {
    /// Returns `None` for an avatar without vertices
    pub(super) fn new(avatar: &Avatar) -> Option<Self> {
        let vertices = || avatar.mesh.positions.iter().zip(&avatar.weights);
        let (&crown, &crown_weight) = vertices().max_by(|a, b| a.0.y.total_cmp(&b.0.y))?;
        let (&sole, &sole_weight) = vertices().min_by(|a, b| a.0.y.total_cmp(&b.0.y))?;
        let heads = avatar.bone_heads;
        Some(Self {
            heads,
            keypoints: avatar.keypoints,
            stretches: PerBone::from_fn(|bone| Stretch::of(bone, &heads)),
            crown: (crown, crown_weight),
            sole: (sole, sole_weight),
        })
    }

    /// Applies scales
    pub(super) fn scaled(&self, scales: &BoneScales) -> ScaledFrame {
        let matrices = self.stretches.map(|stretch| stretch.matrix(scales));
        self.assemble(&Stretched::new(
            &self.heads,
            matrices,
            self.heads[Bone::Root],
        ))
    }

    /// Returns the derivatives of [`Frame::scaled`] by one logarithmic scale
    pub(super) fn rate(&self, scales: &BoneScales, by: BoneScale) -> ScaledFrame {
        let matrices = self.stretches.map(|stretch| stretch.rate(scales, by));
        self.assemble(&Stretched::new(&self.heads, matrices, DVec3::ZERO))
    }

    /// The frame is linear in the bones' matrices, so that one function computes values and derivatives
    fn assemble(&self, stretched: &Stretched) -> ScaledFrame {
        let crown = stretched.blend(self.crown.0, &self.crown.1);
        let sole = stretched.blend(self.sole.0, &self.sole.1);
        let origin = stretched.floor_origin(sole.y);
        ScaledFrame {
            heads: stretched.heads.map(|head| head - origin),
            keypoints: stretched.keypoints(&self.keypoints).map(|k| k - origin),
            stature_mm: crown.y - sole.y,
        }
    }
}

/// Bones after stretching: points are attached to the new heads by the bones' matrices
struct Stretched<'a> {
    rest: &'a PerBone<DVec3>,
    matrices: PerBone<DMat3>,
    heads: PerBone<DVec3>,
}

impl<'a> Stretched<'a> {
    fn new(rest: &'a PerBone<DVec3>, matrices: PerBone<DMat3>, root: DVec3) -> Self {
        let mut heads = PerBone::splat(root);
        for bone in Bone::ALL {
            if let Some(parent) = bone.parent() {
                heads[bone] = heads[parent] + matrices[parent] * (rest[bone] - rest[parent]);
            }
        }
        Self {
            rest,
            matrices,
            heads,
        }
    }

    fn carry(&self, bone: Bone, point: DVec3) -> DVec3 {
        self.heads[bone] + self.matrices[bone] * (point - self.rest[bone])
    }

    fn blend(&self, point: DVec3, weight: &SkinWeight) -> DVec3 {
        weight
            .iter()
            .map(|(bone, w)| self.carry(bone, point) * w)
            .sum()
    }

    fn keypoints(&self, rest: &PerJoint<DVec3>) -> PerJoint<DVec3> {
        let mut keypoints = PerJoint::from_fn(|j| self.carry(j.bone(), rest[j]));
        keypoints.set_middles(|left, right| (left + right) / 2.0);
        keypoints
    }

    /// Returns the point that becomes the origin: on the floor, in x between the ankles, in z on the axis of the
    /// avatar, as the hips are not moved in z
    ///
    /// Seen from the side, an axis that is off by a few mm moves the reference view by pixels, to the right in one
    /// profile and to the left in the other, and silhouettes normalized to it become inconsistent.
    fn floor_origin(&self, floor: f64) -> DVec3 {
        let [left, right] = [Bone::LeftFoot, Bone::RightFoot].map(|b| self.heads[b]);
        DVec3::new((left.x + right.x) / 2.0, floor, 0.0)
    }
}

/// Stretches an avatar along its bones
///
/// Joints move, the surface follows by its skinning weights, vertices keep their order. The result stands on y = 0, and
/// the turning axis keeps its distance behind the hips.
pub fn rescale_avatar(avatar: &Avatar, scales: &BoneScales) -> Avatar {
    let rest = &avatar.bone_heads;
    let matrices = PerBone::from_fn(|bone| Stretch::of(bone, rest).matrix(scales));
    let stretched = Stretched::new(rest, matrices, rest[Bone::Root]);
    let mut scaled = avatar.clone();
    for (point, weight) in scaled.mesh.positions.iter_mut().zip(&avatar.weights) {
        *point = stretched.blend(*point, weight);
    }
    let floor = scaled.mesh.bounds().map_or(0.0, |(lowest, _)| lowest.y);
    let origin = stretched.floor_origin(floor);
    for point in &mut scaled.mesh.positions {
        *point -= origin;
    }
    scaled.bone_heads = stretched.heads.map(|head| head - origin);
    scaled.keypoints = stretched.keypoints(&avatar.keypoints).map(|k| k - origin);
    scaled
}
