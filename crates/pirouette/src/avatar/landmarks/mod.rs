//! Tape loops and landmarks found by the geometry of a body.
//!
//! Works on any upright skinned body in a reference pose, whatever its topology: levels come from the surface
//! where ISO 8559-1 defines them by shape (bust points, seat, crotch, largest calf, smallest ankle) and from
//! the joints where it defines them by bones (waist, knee, upper arm, wrist). Arms are told from the trunk by the
//! skinning weights.
//!
//! Not promised: the girth of a loop's own polygon. Its vertices zigzag around the plane by up to half an edge; a tape is
//! the convex hull of the plane section through them.

mod slice;

use glam::DVec3;
use pirouette_geom::TriMesh;

use super::TapeLoop;
use crate::measure::{Girth, Landmark};
use crate::pose::SkinWeight;
use crate::skeleton::{Bone, Joint};
use slice::{Plane, Slicer};

/// Natural waist as a share of the way from the hip joints up to the neck
///
/// A little above the navel. The middle between rib and crest of the survey lies 1 % of the stature higher,
/// where tapering bodies are 20 to 50 mm thinner.
const WAIST_SHARE: f64 = 0.26;

/// Where the bust is sought, as shares of the way from the upper spine's head to the shoulders, and where it is put
/// on bodies whose chest does not stand out
const BUST_ZONE: [f64; 2] = [0.2, 0.75];
const BUST_FALLBACK: f64 = 0.47;

/// The strip beside the breast bone in which no bust point lies, as a share of the stature
const BUST_MIN_X: f64 = 0.015;

/// Where the seat is sought, relative to the hip joints, as shares of the stature
const SEAT_ZONE: [f64; 2] = [-0.05, 0.045];

/// Points of a profile within this many mm of its extreme are as extreme: skin is flat there, and the middle of the
/// flat part moves less from body to body than its peak
const PLATEAU_MM: f64 = 3.0;

/// Where the crotch is sought, relative to the hip joints, as shares of the stature
const CROTCH_ZONE: [f64; 2] = [-0.11, 0.01];

/// How far above the crotch the fullest seat lies on average, as a share of the stature
///
/// Survey means are 0.023 for men and 0.032 for women. The rearmost point itself wanders by 0.03 with the hollow of the
/// back, so the tape goes midway between the two: on bodies with known tapes within 4 mm, the rearmost point
/// alone 14 to 22 mm too high.
const SEAT_ABOVE_CROTCH: f64 = 0.025;

/// Thigh below the crotch, as a share of the stature: below the fold of the seat
const THIGH_BELOW_CROTCH: f64 = 0.034;

/// Upper arm tape as a share of the way from shoulder to elbow: just below the bulge of the deltoid
const UPPER_ARM_SHARE: f64 = 0.55;

/// Where the largest calf and the smallest ankle are sought, as shares of the way from ankle to knee
const CALF_ZONE: [f64; 2] = [0.45, 0.9];
const ANKLE_ZONE: [f64; 2] = [0.0, 0.4];

/// Where the smallest neck is sought, as shares of the way from the neck's to the head's joint
const NECK_ZONE: [f64; 2] = [0.0, 0.75];

/// How far below its thinnest place the neck is measured, as a share of the stature: there a collar settles
const NECK_BELOW_THINNEST: f64 = 0.008;

/// Radius around the neck's axis, as a share of the stature, that holds the neck but not the shoulders or the chin
const NECK_REACH: f64 = 0.06;

/// Seventh cervical vertebra above the neck's joint, as a share of the stature
const NAPE_ABOVE_NECK: f64 = 0.004;

/// Step of the searches along the body, as a share of the stature
const STEP: f64 = 0.001;

/// Finds tape loops and landmarks of a body in a reference pose
///
/// World frame, mm: upright on the floor, facing +z. `weights` are one per vertex, `heads` the bones' heads.
/// Parts that the surface lacks give no loop. `keypoints` tell nothing yet that the bones do not.
pub fn find(
    mesh: &TriMesh,
    weights: &[SkinWeight],
    heads: &[DVec3; Bone::COUNT],
    _keypoints: &[DVec3; Joint::COUNT],
) -> (Vec<TapeLoop>, Vec<(Landmark, u32)>) {
    let Some(body) = Body::new(mesh, weights, heads) else {
        return (Vec::new(), Vec::new());
    };
    let levels = Levels::find(&body);
    (body.tape_loops(&levels), body.landmarks(&levels))
}

/// A body with its parts told apart
struct Body<'a> {
    mesh: &'a TriMesh,
    surface: Slicer<'a>,
    heads: &'a [DVec3; Bone::COUNT],
    stature: f64,
    /// Everything but the arms
    armless: Vec<bool>,
    trunk: Slicer<'a>,
    left: Limbs<'a>,
    right: Limbs<'a>,
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

/// Heights of the level tapes, in mm
struct Levels {
    bust: f64,
    waist: f64,
    seat: f64,
    crotch: DVec3,
}

impl<'a> Body<'a> {
    fn new(
        mesh: &'a TriMesh,
        weights: &'a [SkinWeight],
        heads: &'a [DVec3; Bone::COUNT],
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
        let middle = (heads[Bone::LeftThigh as usize].x + heads[Bone::RightThigh as usize].x) / 2.0;
        let legs = |outward: f64| -> Vec<bool> {
            let vertices = mesh.positions.iter().zip(&armless);
            vertices
                .map(|(p, &part)| part && (p.x - middle) * outward > 0.0)
                .collect()
        };
        let surface = Slicer::new(mesh);
        let left = Limbs {
            leg: surface.part(&legs(1.0)),
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
            leg: surface.part(&legs(-1.0)),
            arm: surface.part(&right_arm),
            arm_vertices: right_arm,
            upper_arm: Bone::RightUpperArm,
            forearm: Bone::RightForearm,
            hand: Bone::RightHand,
            shin: Bone::RightShin,
            foot: Bone::RightFoot,
            outward: -1.0,
        };
        Some(Self {
            mesh,
            trunk: surface.part(&armless),
            surface,
            heads,
            stature,
            armless,
            left,
            right,
        })
    }

    fn head(&self, bone: Bone) -> DVec3 {
        self.heads[bone as usize]
    }

    fn middle_of(&self, left: Bone, right: Bone) -> DVec3 {
        (self.head(left) + self.head(right)) / 2.0
    }

    /// Heights from `low` to `high` in steps of about [`STEP`]
    fn heights(&self, low: f64, high: f64) -> Vec<f64> {
        let count = ((high - low) / (STEP * self.stature))
            .ceil()
            .clamp(1.0, 1000.0) as usize;
        (0..=count)
            .map(|i| low + (high - low) * i as f64 / count as f64)
            .collect()
    }

    /// The vertex of a part that is best by a score; `None` for an empty part
    fn best_vertex(&self, part: &[bool], score: impl Fn(DVec3) -> f64) -> Option<u32> {
        let vertices = self.mesh.positions.iter().zip(part).enumerate();
        vertices
            .filter(|(_, (_, inside))| **inside)
            .map(|(v, (&p, _))| (v as u32, score(p)))
            .filter(|(_, score)| score.is_finite())
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(v, _)| v)
    }

    fn nearest_vertex(&self, part: &[bool], point: DVec3) -> Option<u32> {
        self.best_vertex(part, |p| -p.distance_squared(point))
    }
}

impl Levels {
    fn find(body: &Body<'_>) -> Self {
        let stature = body.stature;
        let hips = body.middle_of(Bone::LeftThigh, Bone::RightThigh);
        let shoulders = body.middle_of(Bone::LeftUpperArm, Bone::RightUpperArm);
        let spine = body.head(Bone::UpperSpine);

        let chest = |share: f64| spine.y + share * (shoulders.y - spine.y);
        let bust_heights = body.heights(chest(BUST_ZONE[0]), chest(BUST_ZONE[1]));
        let chest_surface = body.trunk.between(chest(BUST_ZONE[0]), chest(BUST_ZONE[1]));
        let side_level = |outward: f64| {
            let beside = |p: DVec3| (p.x - spine.x) * outward > BUST_MIN_X * stature;
            peak(&profile(&bust_heights, |y| {
                reach(&chest_surface, y, 1.0, beside)
            }))
        };
        let bust = match (side_level(1.0), side_level(-1.0)) {
            (Some(left), Some(right)) => (left + right) / 2.0,
            (Some(one), None) | (None, Some(one)) => one,
            (None, None) => chest(BUST_FALLBACK),
        };

        let around_hips = |zone: [f64; 2]| zone.map(|share| hips.y + share * stature);
        let [low, high] = around_hips(SEAT_ZONE);
        let seat_heights = body.heights(low, high);
        let seat_surface = body.trunk.between(low, high);
        let seat = plateau(&profile(&seat_heights, |y| {
            reach(&seat_surface, y, -1.0, |_| true)
        }));

        let [low, high] = around_hips(CROTCH_ZONE);
        let mid_plane = Plane {
            origin: hips,
            normal: DVec3::X,
        };
        let crotch = body
            .trunk
            .cut(mid_plane)
            .into_iter()
            .map(|c| c.point)
            .filter(|p| (low..high).contains(&p.y))
            .min_by(|a, b| a.y.total_cmp(&b.y));

        let crotch = crotch.unwrap_or(DVec3::new(hips.x, low, hips.z));
        let average_seat = crotch.y + SEAT_ABOVE_CROTCH * stature;

        let neck = body.head(Bone::Neck);
        Self {
            bust,
            waist: hips.y + WAIST_SHARE * (neck.y - hips.y),
            seat: seat.map_or(average_seat, |rearmost| (rearmost + average_seat) / 2.0),
            crotch,
        }
    }
}

/// A quantity at each height where there is one
fn profile(heights: &[f64], value: impl Fn(f64) -> Option<f64>) -> Vec<(f64, f64)> {
    heights
        .iter()
        .filter_map(|&y| Some((y, value(y)?)))
        .collect()
}

/// How far a section reaches along z, forward for `forward` 1 and backward for -1, among the points that `keep` allows
fn reach(surface: &Slicer<'_>, y: f64, forward: f64, keep: impl Fn(DVec3) -> bool) -> Option<f64> {
    surface
        .cut(Plane::level(y))
        .iter()
        .filter(|c| keep(c.point))
        .map(|c| c.point.z * forward)
        .reduce(f64::max)
}

/// Where a profile has its highest local maximum inside, `None` when it only rises or falls
fn peak(profile: &[(f64, f64)]) -> Option<f64> {
    let (_, inside) = profile
        .windows(3)
        .filter(|w| w[0].1 <= w[1].1 && w[1].1 >= w[2].1)
        .map(|w| (w[1].1, w[1].0))
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(inside)
}

/// The middle of the heights at which a profile is within [`PLATEAU_MM`] of its maximum
fn plateau(profile: &[(f64, f64)]) -> Option<f64> {
    let top = profile.iter().map(|&(_, value)| value).reduce(f64::max)?;
    let flat: Vec<f64> = profile
        .iter()
        .filter(|&&(_, value)| value >= top - PLATEAU_MM)
        .map(|&(y, _)| y)
        .collect();
    Some(flat.iter().sum::<f64>() / flat.len() as f64)
}

impl Body<'_> {
    fn tape_loops(&self, levels: &Levels) -> Vec<TapeLoop> {
        let trunk = &self.trunk;
        let mut loops = Vec::new();
        let mut add = |girth: Girth, part: &Slicer<'_>, plane: Plane| {
            if let Some(vertices) = part.tape(plane) {
                loops.push(TapeLoop { girth, vertices });
            }
        };
        let (neck_part, neck_plane) = self.neck();
        add(Girth::Neck, &neck_part, neck_plane);
        add(Girth::Bust, trunk, Plane::level(levels.bust));
        add(Girth::Waist, trunk, Plane::level(levels.waist));
        add(Girth::Hip, trunk, Plane::level(levels.seat));
        let [left, right] = [
            [
                Girth::LeftThigh,
                Girth::LeftKnee,
                Girth::LeftCalf,
                Girth::LeftAnkle,
                Girth::LeftUpperArm,
                Girth::LeftWrist,
            ],
            [
                Girth::RightThigh,
                Girth::RightKnee,
                Girth::RightCalf,
                Girth::RightAnkle,
                Girth::RightUpperArm,
                Girth::RightWrist,
            ],
        ];
        for (limbs, [thigh, knee, calf, ankle, upper_arm, wrist]) in
            [(&self.left, left), (&self.right, right)]
        {
            let (knee_joint, ankle_joint) = (self.head(limbs.shin), self.head(limbs.foot));
            let thigh_level = levels.crotch.y - THIGH_BELOW_CROTCH * self.stature;
            add(thigh, &limbs.leg, Plane::level(thigh_level));
            add(knee, &limbs.leg, Plane::level(knee_joint.y));
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
            let smallest = girths(ANKLE_ZONE)
                .into_iter()
                .min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((y, _)) = smallest {
                add(ankle, &limbs.leg, Plane::level(y));
            }
            if let Some(plane) = across(
                self.head(limbs.upper_arm),
                self.head(limbs.forearm),
                UPPER_ARM_SHARE,
            ) {
                add(upper_arm, &limbs.arm, plane);
            }
            if let Some(plane) = across(self.head(limbs.forearm), self.head(limbs.hand), 1.0) {
                add(wrist, &limbs.arm, plane);
            }
        }
        loops
    }

    /// The neck's surface, and the plane across its axis where it is thinnest
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
        let plane = |t: f64| Plane {
            origin: low.lerp(high, t),
            normal,
        };
        let step = STEP * self.stature / (high - low).length().max(1.0);
        let count = ((NECK_ZONE[1] - NECK_ZONE[0]) / step).clamp(1.0, 200.0) as usize;
        let thinnest = (0..=count)
            .map(|i| NECK_ZONE[0] + (NECK_ZONE[1] - NECK_ZONE[0]) * i as f64 / count as f64)
            .map(|t| (t, part.girth(plane(t))))
            .filter(|&(_, girth)| girth > 0.0)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let t = thinnest.map_or(0.5, |(t, _)| t);
        let drop = NECK_BELOW_THINNEST * self.stature / (high - low).length().max(1.0);
        (part, plane(t - drop))
    }

    fn landmarks(&self, levels: &Levels) -> Vec<(Landmark, u32)> {
        let all = vec![true; self.mesh.positions.len()];
        let trunk = &self.armless;
        let mut found: Vec<(Landmark, u32)> = Vec::new();
        let mut add = |landmark: Landmark, vertex: Option<u32>| {
            found.extend(vertex.map(|v| (landmark, v)));
        };
        add(Landmark::Crown, self.best_vertex(&all, |p| p.y));
        let nape = self.head(Bone::Neck) + DVec3::Y * NAPE_ABOVE_NECK * self.stature;
        add(Landmark::Nape, self.mid_point(nape.y, -1.0));
        add(Landmark::WaistFront, self.mid_point(levels.waist, 1.0));
        add(Landmark::WaistBack, self.mid_point(levels.waist, -1.0));
        let near = |level: f64| move |y: f64| (y - level).abs();
        let band = 0.01 * self.stature;
        let from_seat = near(levels.seat);
        let seat = self.best_vertex(trunk, |p| {
            if from_seat(p.y) < band {
                -p.z
            } else {
                f64::NAN
            }
        });
        add(Landmark::Seat, seat);
        add(Landmark::Crotch, self.nearest_vertex(trunk, levels.crotch));
        let from_bust = near(levels.bust);
        for (limbs, bust, acromion, wrist) in [
            (
                &self.left,
                Landmark::LeftBustPoint,
                Landmark::LeftAcromion,
                Landmark::LeftWrist,
            ),
            (
                &self.right,
                Landmark::RightBustPoint,
                Landmark::RightAcromion,
                Landmark::RightWrist,
            ),
        ] {
            let middle = self.head(Bone::UpperSpine).x;
            let point = self.best_vertex(trunk, |p| {
                let beside = (p.x - middle) * limbs.outward > BUST_MIN_X * self.stature;
                if beside && from_bust(p.y) < band {
                    p.z
                } else {
                    f64::NAN
                }
            });
            add(bust, point);
            // straight above the joint
            let shoulder = self.head(limbs.upper_arm);
            let acromion_vertex = self.best_vertex(&all, |p| {
                let beside = DVec3::new(p.x - shoulder.x, 0.0, p.z - shoulder.z).length();
                if p.y > shoulder.y {
                    p.y - shoulder.y - 3.0 * beside
                } else {
                    f64::NAN
                }
            });
            add(acromion, acromion_vertex);
            // the outer side of the wrist, which the upper arm's direction points to
            let (elbow, hand) = (self.head(limbs.forearm), self.head(limbs.hand));
            if let Some(along) = (hand - elbow).try_normalize() {
                let out = DVec3::X * limbs.outward + DVec3::Y;
                let out = (out - along * out.dot(along)).normalize_or(DVec3::Y);
                let vertex = self.best_vertex(&limbs.arm_vertices, |p| {
                    let from_joint = p - hand;
                    from_joint.dot(out) - 3.0 * from_joint.dot(along).abs()
                });
                add(wrist, vertex);
            }
        }
        found
    }

    /// The vertex nearest to where the mid plane meets the front (`forward` 1) or the back (-1) of the trunk
    fn mid_point(&self, y: f64, forward: f64) -> Option<u32> {
        let middle = self.middle_of(Bone::LeftThigh, Bone::RightThigh).x;
        let strip = BUST_MIN_X * self.stature;
        let surface = self.trunk.between(y, y);
        let z = reach(&surface, y, forward, |p| (p.x - middle).abs() < strip)? * forward;
        self.nearest_vertex(&self.armless, DVec3::new(middle, y, z))
    }
}

/// The plane across a bone at a share of its length
fn across(from: DVec3, to: DVec3, share: f64) -> Option<Plane> {
    Some(Plane {
        origin: from.lerp(to, share),
        normal: (to - from).try_normalize()?,
    })
}

#[cfg(test)]
mod tests;
