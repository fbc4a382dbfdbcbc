//! Tapes and landmarks found by the geometry of a body.
//!
//! Works on any upright skinned body in a reference pose, regardless of its topology: levels come from the surface
//! where ISO 8559-1 defines them by shape (bust points, seat, crotch, largest calf, smallest ankle) and from the joints
//! where it defines them by bones (waist, knee, upper arm, wrist). The skinning weights separate arms from the trunk.
//!
//! # Source
//! ISO 8559-1:2017.

mod levels;
mod points;
mod slice;

use glam::DVec3;
use pirouette_geom::TriMesh;

use super::{Girth, Landmark};
use levels::{Levels, STEP, profile};
use pirouette_body::{Avatar, Bone, PerBone, Pose, ReferencePose, SkinWeight};
pub(super) use slice::Plane;
use slice::{Crossing, Slicer};

/// Position of a tape on a body
#[derive(Debug, Clone)]
pub(super) struct Section {
    /// The girth that it measures
    pub(in crate::measure) girth: Girth,
    /// The plane of the tape, world frame, mm
    pub(in crate::measure) plane: Plane,
    /// Intersections of the plane with the surface, unordered
    pub(in crate::measure) points: Vec<DVec3>,
    /// The vertices next to these points, in order along the tape
    pub(in crate::measure) vertices: Vec<u32>,
    /// Change of the tape's length per mm of displacement of its plane, in either direction
    pub(in crate::measure) girth_slope: f64,
}

/// Girth slopes are computed over this share of the stature (8 mm) to either side: the size of position errors of tapes
const TAPER_REACH: f64 = 0.005;

/// Thigh below the crotch, as a share of the stature: below the fold of the seat
const THIGH_BELOW_CROTCH: f64 = 0.034;

/// Upper arm tape as a share of the way from shoulder to elbow: just below the bulge of the deltoid
const UPPER_ARM_SHARE: f64 = 0.55;

/// Ranges searched for the largest calf and the smallest ankle, as shares of the way from ankle to knee
const CALF_ZONE: [f64; 2] = [0.45, 0.9];
const ANKLE_ZONE: [f64; 2] = [0.0, 0.4];

/// Range searched for the thinnest wrist, as shares of the way from elbow to wrist joint
///
/// At the joint itself girths grow toward the hand by 1 mm per mm, and joints are misplaced by 5 mm.
const WRIST_ZONE: [f64; 2] = [0.88, 1.0];

/// Range searched for the thickest forearm, as shares of the way from elbow to wrist joint
const FOREARM_ZONE: [f64; 2] = [0.08, 0.4];

/// Range searched for the thinnest place below the knee, as shares of the way from ankle to knee
const LOWER_KNEE_ZONE: [f64; 2] = [0.84, 1.0];

/// Range searched for the smallest neck, as shares of the way from the neck's to the head's joint
const NECK_ZONE: [f64; 2] = [0.0, 0.75];

/// Forward tilt of its plane, front lower, in degrees
///
/// Perpendicular to the spine of the neck, which tilts forward by 10 degrees and more, tapes would cut into the nape.
const NECK_TILT_DEGREES: f64 = 5.0;

/// The walls of the trunk are found this far below the lowest points where arms touch it, as a share of the stature
const WALL_BELOW: f64 = 0.004;

/// Step of the search, as a share of the stature
const NECK_STEP: f64 = 0.002;

/// Range searched for the largest girth of the head above the ears, as shares of the stature below the crown
const HEAD_ZONE: [f64; 2] = [0.065, 0.03];

/// Radius around the neck's axis, as a share of the stature, that holds the neck but not the shoulders or the chin
const NECK_REACH: f64 = 0.06;

/// Finds the tapes of an avatar from its current shape, and its landmarks, points of its surface
///
/// Girths of parts that the surface lacks are omitted.
pub(super) fn find_sections(avatar: &Avatar) -> (Vec<Section>, Vec<(Landmark, DVec3)>) {
    let Some(mut body) = Body::new(&avatar.mesh, &avatar.weights, &avatar.bone_heads) else {
        return (Vec::new(), Vec::new());
    };
    body.lifted |= avatar.pose == ReferencePose::T;
    let levels = Levels::find(&body);
    (body.sections(&levels), body.landmarks(&levels))
}

/// Returns an avatar in T-pose with the arms of an A-pose; `None` for an avatar in A-pose
///
/// Arms stretched out level lift chest and shoulders: tapes and landmarks there are measured with the arms lowered.
pub(super) fn with_lowered_arms(avatar: &Avatar) -> Option<Avatar> {
    if avatar.pose == ReferencePose::A {
        return None;
    }
    let mut pose = Pose::default();
    let angle = ReferencePose::A.arm_angle_degrees() - avatar.pose.arm_angle_degrees();
    let down = DVec3::Z * angle.to_radians();
    pose.rotations[Bone::LeftUpperArm] = -down;
    pose.rotations[Bone::RightUpperArm] = down;
    Some(avatar.reposed(&pose))
}

/// A body divided into its parts
struct Body<'a> {
    mesh: &'a TriMesh,
    surface: Slicer<'a>,
    heads: &'a PerBone<DVec3>,
    stature: f64,
    /// Everything except the arms
    armless: Vec<bool>,
    /// Vertices of the left half
    is_left: Vec<bool>,
    trunk: Slicer<'a>,
    left: Limbs<'a>,
    right: Limbs<'a>,
    /// Whether arms are, or were, stretched out level: skin of the armpits is lifted
    lifted: bool,
}

/// The limbs of one side
struct Limbs<'a> {
    leg: Slicer<'a>,
    arm_vertices: Vec<bool>,
    arm: Slicer<'a>,
    upper_arm: Bone,
    forearm: Bone,
    hand: Bone,
    shin: Bone,
    foot: Bone,
    /// +1 to the person's left
    outward: f64,
}

impl<'a> Body<'a> {
    fn new(
        mesh: &'a TriMesh,
        weights: &'a [SkinWeight],
        heads: &'a PerBone<DVec3>,
    ) -> Option<Self> {
        let (low, high) = mesh.bounds()?;
        let stature = high.y - low.y;
        if !(stature > 0.0 && stature.is_finite()) || weights.len() != mesh.positions.len() {
            return None;
        }
        let where_weight =
            |bone: Bone| -> Vec<bool> { weights.iter().map(|w| w.below(bone) >= 0.5).collect() };
        let (left_arm, right_arm) = (
            where_weight(Bone::LeftUpperArm),
            where_weight(Bone::RightUpperArm),
        );
        let armless: Vec<bool> = left_arm
            .iter()
            .zip(&right_arm)
            .map(|(l, r)| !l && !r)
            .collect();
        let middle = (heads[Bone::LeftThigh].x + heads[Bone::RightThigh].x) / 2.0;
        let is_left: Vec<bool> = mesh
            .positions
            .iter()
            .zip(weights)
            .map(|(p, weight)| is_on_left(weight, p.x - middle))
            .collect();
        let legs = |left: bool| -> Vec<bool> {
            let vertices = is_left.iter().zip(&armless);
            vertices
                .map(|(&is_left, &part)| part && is_left == left)
                .collect()
        };
        let surface = Slicer::new(mesh);
        let left = Limbs {
            leg: surface.part(&legs(true)),
            arm: surface.part(&left_arm),
            arm_vertices: left_arm,
            upper_arm: Bone::LeftUpperArm,
            forearm: Bone::LeftForearm,
            hand: Bone::LeftHand,
            shin: Bone::LeftShin,
            foot: Bone::LeftFoot,
            outward: 1.0,
        };
        let right = Limbs {
            leg: surface.part(&legs(false)),
            arm: surface.part(&right_arm),
            arm_vertices: right_arm,
            upper_arm: Bone::RightUpperArm,
            forearm: Bone::RightForearm,
            hand: Bone::RightHand,
            shin: Bone::RightShin,
            foot: Bone::RightFoot,
            outward: -1.0,
        };
        let arm = heads[Bone::LeftForearm] - heads[Bone::LeftUpperArm];
        Some(Self {
            lifted: arm.y.abs() < arm.x.abs() / 2.0,
            mesh,
            trunk: surface.part(&armless),
            surface,
            heads,
            stature,
            armless,
            is_left,
            left,
            right,
        })
    }

    fn head(&self, bone: Bone) -> DVec3 {
        self.heads[bone]
    }

    fn middle_of(&self, left: Bone, right: Bone) -> DVec3 {
        (self.head(left) + self.head(right)) / 2.0
    }

    /// Returns heights from `low` to `high` in steps of about [`STEP`]
    fn heights(&self, low: f64, high: f64) -> Vec<f64> {
        let count = ((high - low) / (STEP * self.stature))
            .ceil()
            .clamp(1.0, 1000.0) as usize;
        (0..=count)
            .map(|i| low + (high - low) * i as f64 / count as f64)
            .collect()
    }
}

/// Returns whether a vertex is part of the left half of the body
///
/// Skin of a leg belongs to its side even where it reaches beyond the middle, as that of thighs that touch does.
fn is_on_left(weight: &SkinWeight, to_left_mm: f64) -> bool {
    const LEG: f64 = 0.01;
    let more_left = weight.below(Bone::LeftThigh) - weight.below(Bone::RightThigh);
    if more_left.abs() > LEG {
        more_left > 0.0
    } else {
        to_left_mm > 0.0
    }
}

impl Body<'_> {
    fn sections(&self, levels: &Levels) -> Vec<Section> {
        let trunk = &self.trunk;
        let mut sections = Vec::new();
        let mut add = |girth: Girth, part: &Slicer<'_>, plane: Plane| {
            if let Some((points, vertices)) = part.tape(plane) {
                let by = TAPER_REACH * self.stature;
                let [above, below] = [by, -by].map(|by| part.girth(plane.moved(by)));
                sections.push(Section {
                    girth,
                    plane,
                    points,
                    vertices,
                    girth_slope: (above - below).abs() / (2.0 * by),
                });
            }
        };
        if let Some(plane) = self.fullest_head() {
            add(Girth::Head, trunk, plane);
        }
        let (neck_part, neck_plane) = self.neck();
        add(Girth::Neck, &neck_part, neck_plane);
        let chest = self.chest(levels);
        add(Girth::Bust, &chest, Plane::level(levels.bust));
        add(Girth::Underbust, &chest, Plane::level(levels.underbust));
        add(Girth::Waist, trunk, Plane::level(levels.waist));
        add(Girth::Hip, trunk, Plane::level(levels.seat));
        add(Girth::Overbust, &chest, Plane::level(levels.overbust));
        if let Some(level) = levels.narrowest_waist {
            add(Girth::NarrowestWaist, trunk, Plane::level(level));
        }
        let high_hip = (levels.waist + levels.seat) / 2.0;
        add(Girth::HighHip, trunk, Plane::level(high_hip));
        let [left, right] = [
            [
                Girth::LeftThigh,
                Girth::LeftKnee,
                Girth::LeftCalf,
                Girth::LeftAnkle,
                Girth::LeftUpperArm,
                Girth::LeftWrist,
                Girth::LeftMidThigh,
                Girth::LeftLowerKnee,
                Girth::LeftElbow,
                Girth::LeftForearm,
            ],
            [
                Girth::RightThigh,
                Girth::RightKnee,
                Girth::RightCalf,
                Girth::RightAnkle,
                Girth::RightUpperArm,
                Girth::RightWrist,
                Girth::RightMidThigh,
                Girth::RightLowerKnee,
                Girth::RightElbow,
                Girth::RightForearm,
            ],
        ];
        for (limbs, girths) in [(&self.left, left), (&self.right, right)] {
            let [thigh, knee, calf, ankle, upper_arm, wrist, ..] = girths;
            let [.., mid_thigh, lower_knee, elbow, forearm] = girths;
            let (knee_joint, ankle_joint) = (self.head(limbs.shin), self.head(limbs.foot));
            let thigh_level = levels.crotch.y - THIGH_BELOW_CROTCH * self.stature;
            add(thigh, &limbs.leg, Plane::level(thigh_level));
            add(knee, &limbs.leg, Plane::level(knee_joint.y));
            let middle = (levels.crotch.y + knee_joint.y) / 2.0;
            add(mid_thigh, &limbs.leg, Plane::level(middle));
            let girths = |zone: [f64; 2]| {
                let [low, high] = zone.map(|t| ankle_joint.lerp(knee_joint, t).y);
                let leg = limbs.leg.between(low, high);
                profile(&self.heights(low, high), |y| {
                    Some(leg.girth(Plane::level(y))).filter(|&g| g > 0.0)
                })
            };
            let largest = girths(CALF_ZONE)
                .into_iter()
                .max_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((y, _)) = largest {
                add(calf, &limbs.leg, Plane::level(y));
            }
            for (girth, zone) in [(ankle, ANKLE_ZONE), (lower_knee, LOWER_KNEE_ZONE)] {
                let smallest = girths(zone).into_iter().min_by(|a, b| a.1.total_cmp(&b.1));
                if let Some((y, _)) = smallest {
                    add(girth, &limbs.leg, Plane::level(y));
                }
            }
            if let Some(plane) = across(
                self.head(limbs.upper_arm),
                self.head(limbs.forearm),
                UPPER_ARM_SHARE,
            ) {
                add(upper_arm, &limbs.arm, plane);
            }
            if let Some(plane) = self.thinnest_wrist(limbs) {
                add(wrist, &limbs.arm, plane);
            }
            let [shoulder_joint, elbow_joint, wrist_joint] =
                [limbs.upper_arm, limbs.forearm, limbs.hand].map(|bone| self.head(bone));
            // The arm hardly bends there: across the line from shoulder to wrist
            let along = (wrist_joint - shoulder_joint).try_normalize();
            if let Some(normal) = along {
                let plane = Plane {
                    origin: elbow_joint,
                    normal,
                };
                add(elbow, &limbs.arm, plane);
            }
            if let Some(plane) = self.thickest_forearm(limbs) {
                add(forearm, &limbs.arm, plane);
            }
        }
        sections
    }

    /// Returns the trunk without the roots of the arms: above the lowest points where arms touch it, it ends at the walls
    /// below
    fn chest(&self, levels: &Levels) -> Slicer<'_> {
        let below = Plane::level(levels.arms_part - WALL_BELOW * self.stature);
        let middle = self.head(Bone::UpperSpine).x;
        let beside = |c: &Crossing| c.point.x - middle;
        let walls = self
            .trunk
            .cut(below)
            .iter()
            .map(beside)
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
                [low.min(x), high.max(x)]
            });
        let positions = self.mesh.positions.iter().zip(&self.armless);
        let part: Vec<bool> = positions
            .map(|(p, &armless)| {
                let within = (walls[0]..=walls[1]).contains(&(p.x - middle));
                armless && (within || p.y < levels.arms_part)
            })
            .collect();
        self.surface.part(&part)
    }

    /// Returns the plane across the forearm above the wrist joint where it is thinnest
    fn thinnest_wrist(&self, limbs: &Limbs<'_>) -> Option<Plane> {
        let planes = self.across_forearm(limbs, WRIST_ZONE);
        let thinnest = planes.min_by(|a, b| a.1.total_cmp(&b.1));
        thinnest.map(|(plane, _)| plane)
    }

    /// Returns the plane across the forearm below the elbow where it is thickest
    fn thickest_forearm(&self, limbs: &Limbs<'_>) -> Option<Plane> {
        let planes = self.across_forearm(limbs, FOREARM_ZONE);
        let thickest = planes.max_by(|a, b| a.1.total_cmp(&b.1));
        thickest.map(|(plane, _)| plane)
    }

    /// Returns planes across a forearm with their girths, in a range of shares of the way from elbow to wrist joint
    fn across_forearm(
        &self,
        limbs: &Limbs<'_>,
        [low, high]: [f64; 2],
    ) -> impl Iterator<Item = (Plane, f64)> {
        const STEPS: u32 = 12;
        let (elbow, hand) = (self.head(limbs.forearm), self.head(limbs.hand));
        (0..=STEPS).filter_map(move |i| {
            let share = low + (high - low) * f64::from(i) / f64::from(STEPS);
            let plane = across(elbow, hand, share)?;
            Some((plane, limbs.arm.girth(plane))).filter(|&(_, girth)| girth > 0.0)
        })
    }

    /// Returns the level plane over the ears at which the head is largest
    fn fullest_head(&self) -> Option<Plane> {
        let [low, high] = HEAD_ZONE.map(|share| (1.0 - share) * self.stature);
        let head = self.trunk.between(low, high);
        let girths = profile(&self.heights(low, high), |y| {
            Some(head.girth(Plane::level(y))).filter(|&g| g > 0.0)
        });
        let largest = girths.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        largest.map(|(y, _)| Plane::level(y))
    }

    /// Returns the neck's surface, and the plane across its axis where it is thinnest
    fn neck(&self) -> (Slicer<'_>, Plane) {
        let (low, high) = (self.head(Bone::Neck), self.head(Bone::Head));
        let normal = (high - low).try_normalize().unwrap_or(DVec3::Y);
        let part: Vec<bool> = self
            .mesh
            .positions
            .iter()
            .map(|&p| {
                let from_low = p - low;
                let beside = from_low - normal * from_low.dot(normal);
                beside.length() < NECK_REACH * self.stature
            })
            .collect();
        let part = self.surface.part(&part);
        let step = NECK_STEP * self.stature / (high - low).length().max(1.0);
        let count = ((NECK_ZONE[1] - NECK_ZONE[0]) / step).clamp(1.0, 200.0) as usize;
        let shares = (0..=count)
            .map(|i| NECK_ZONE[0] + (NECK_ZONE[1] - NECK_ZONE[0]) * i as f64 / count as f64);
        let (sin, cos) = f64::to_radians(NECK_TILT_DEGREES).sin_cos();
        let across = |t: f64| Plane {
            origin: low.lerp(high, t),
            normal: DVec3::new(0.0, cos, sin),
        };
        let thinnest = shares
            .map(across)
            .map(|plane| (plane, part.girth(plane)))
            .filter(|&(_, girth)| girth > 0.0)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let plane = thinnest.map_or(across(0.5), |(plane, _)| plane);
        (part, plane)
    }
}

/// Returns the plane across a bone at a share of its length
fn across(from: DVec3, to: DVec3, share: f64) -> Option<Plane> {
    Some(Plane {
        origin: from.lerp(to, share),
        normal: (to - from).try_normalize()?,
    })
}

#[cfg(test)]
mod tests;
