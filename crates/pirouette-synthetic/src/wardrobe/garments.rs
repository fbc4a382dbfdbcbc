//! Garments that follow the body: its surface, displaced outward.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use pirouette_body::{Avatar, Bone, SkinWeight};
use pirouette_geom::TriMesh;
use pirouette_geom::nearest::NearestSurface;
use pirouette_geom::winding::WindingNumbers;

use super::body::Marks;
use super::polar::{Polar, Ring};
use super::{Bottom, Garment, Hair, Outfit, smooth_step};
use crate::random::{Random, noise};

/// Thickness of hair on the skull, in mm
const HAIR_MM: f64 = 10.0;

/// Distance of a shoe from the foot, in mm
const SHOE_MM: f64 = 8.0;

/// Ease of trouser legs and of sleeves, as shares of the ease of the garment
const LEG_EASE: f64 = 0.6;
const SLEEVE_EASE: f64 = 0.45;

/// Least ease of the end of a trouser leg that is not tight, in mm
const HEM_EASE_MM: f64 = 70.0;

/// Half the wavelength of folds, in mm: shortest and longest; upright folds are several times as long
const FOLD_MM: [f64; 2] = [30.0, 75.0];
const FOLD_LENGTH: f64 = 4.0;

/// Largest distance of garments from each other and from skin where they end, in mm along the body
const HEM_STEP_MM: f64 = 6.0;

/// A region draped with cloth
struct Drape {
    polar: Polar,
    distances: Vec<Ring>,
}

impl Drape {
    fn at(&self, place: DVec3) -> DVec3 {
        self.polar.outward(place) * self.polar.value_at(&self.distances, place)
    }
}

/// Returns the position of each vertex of the body with hair and garments, barefoot
pub(super) fn clothed(avatar: &Avatar, marks: &Marks, outfit: &Outfit, seed: u64) -> Vec<DVec3> {
    let normals = smooth_normals(&avatar.mesh);
    let folds = Folds::new(seed);
    let trousers = match outfit.bottom {
        Bottom::Trousers(garment) => garment,
        Bottom::Skirt { .. } => NONE,
    };
    let trunk = trunk(avatar, marks);
    let drape_trunk = |garment: Garment| {
        let polar = trunk.clone()?;
        (garment.ease_mm > 0.0).then(|| Drape {
            distances: polar.drape(|_| garment.ease_mm),
            polar,
        })
    };
    let (top, bottom) = (drape_trunk(outfit.top), drape_trunk(trousers));
    let legs = [Bone::LeftThigh, Bone::RightThigh].map(|thigh| leg(avatar, marks, thigh, trousers));
    let positions = &avatar.mesh.positions;
    let mut worn: Vec<DVec3> = Vec::with_capacity(positions.len());
    for ((&place, weight), &normal) in positions.iter().zip(&avatar.weights).zip(&normals) {
        let above_hem = cut(place.y, marks.top_hem_mm);
        let fold = |garment: Garment| garment.folds_mm * folds.at(place);
        let thin = |garment: Garment| normal * (garment.ease_mm / TAU).min(3.0);
        // The top lies on the shoulders, and is open at the neck.
        let chest = 1.0 - smooth_step(0.92, 1.0, place.y / marks.shoulder_mm);
        let neck = 1.0 - cut(place.y, marks.neck_mm - 0.01 * marks.stature_mm);
        let on_trunk = |drape: &Option<Drape>, garment: Garment| match drape {
            Some(drape) => {
                let out = drape.polar.outward(place);
                drape.at(place) * chest
                    + thin(garment) * (1.0 - chest)
                    + out * fold(garment) * chest
            }
            None => DVec3::ZERO,
        };
        let below_waist = 1.0 - cut(place.y, marks.waist_mm);
        let lower = on_trunk(&bottom, trousers) * below_waist;
        let upper = on_trunk(&top, outfit.top) * above_hem * neck;
        let of_trunk = if upper.length() > lower.length() {
            upper
        } else {
            lower
        };

        let mut moved = DVec3::ZERO;
        let mut rest = 1.0 - weight.below(Bone::Neck);
        for (thigh, drape) in [Bone::LeftThigh, Bone::RightThigh].into_iter().zip(&legs) {
            let share = weight.below(thigh);
            rest -= share;
            if let Some(drape) = drape {
                let on = cut(place.y, marks.trouser_hem_mm);
                let out = drape.polar.outward(place);
                let cloth = (drape.at(place) + out * fold(trousers)) * on;
                // The top hangs over the upper end of the legs.
                moved += share
                    * if upper.length() > cloth.length() {
                        upper
                    } else {
                        cloth
                    };
            } else {
                moved += share * upper;
            }
        }
        for side in [
            [Bone::LeftUpperArm, Bone::LeftForearm, Bone::LeftHand],
            [Bone::RightUpperArm, Bone::RightForearm, Bone::RightHand],
        ] {
            let share = weight.below(side[0]);
            rest -= share;
            let [shoulder, elbow, wrist] = side.map(|bone| avatar.bone_heads[bone]);
            let along = (place - shoulder).dot((elbow - shoulder).normalize_or_zero())
                / shoulder.distance(elbow).max(1.0);
            let beyond = (place - elbow).dot((wrist - elbow).normalize_or_zero())
                / elbow.distance(wrist).max(1.0);
            let along = if beyond > 0.0 {
                1.0 + beyond
            } else {
                along.min(1.0)
            };
            let on = 1.0 - smooth_step(-0.02, 0.02, along - outfit.sleeve);
            // Sleeves hang from the arm.
            let hang = 0.7 + 0.6 * (0.5 - 0.5 * normal.y);
            let away = SLEEVE_EASE * outfit.top.ease_mm / TAU * hang + fold(outfit.top);
            moved += share * normal * away.max(0.0) * on;
        }
        moved += rest.max(0.0) * of_trunk;
        if outfit.hair != Hair::Shaved && outfit.hair != Hair::Hat {
            let share = weight.of(Bone::Head) * marks.hair_share(place);
            moved += normal * HAIR_MM * share;
        }
        // Cloth is outside of the skin.
        let depth = moved.dot(normal).min(0.0);
        worn.push(place + moved - normal * depth);
    }
    out_of_body(avatar, &mut worn);
    worn
}

const NONE: Garment = Garment {
    ease_mm: 0.0,
    folds_mm: 0.0,
};

/// Returns 0 below a hem and 1 above it
fn cut(y: f64, hem_mm: f64) -> f64 {
    smooth_step(-HEM_STEP_MM, HEM_STEP_MM, y - hem_mm)
}

/// Returns the radii of the trunk, with the thighs down to below the crotch
fn trunk(avatar: &Avatar, marks: &Marks) -> Option<Polar> {
    let low = marks.hip_mm - 0.08 * marks.stature_mm;
    let points = places(avatar, |weight| {
        weight.below(Bone::LeftUpperArm) < 0.3
            && weight.below(Bone::RightUpperArm) < 0.3
            && weight.below(Bone::Neck) < 0.5
    });
    Polar::new(points.into_iter(), [low, marks.shoulder_mm], |_| {
        marks.trunk_axis
    })
}

/// Returns points of a part of the body: its vertices, and points of the edges between them
///
/// Vertices alone are farther apart than the levels, and leave directions empty.
pub(super) fn places(avatar: &Avatar, of_part: impl Fn(&SkinWeight) -> bool) -> Vec<DVec3> {
    let inside: Vec<bool> = avatar.weights.iter().map(of_part).collect();
    let edges = avatar.mesh.edges().into_iter();
    edges
        .map(|edge| edge.map(|v| v as usize))
        .filter(|edge| edge.iter().all(|&v| inside[v]))
        .flat_map(|edge| {
            let [a, b] = edge.map(|v| avatar.mesh.positions[v]);
            [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| a.lerp(b, t))
        })
        .collect()
}

fn leg(avatar: &Avatar, marks: &Marks, thigh: Bone, garment: Garment) -> Option<Drape> {
    if garment.ease_mm <= 0.0 {
        return None;
    }
    let [shin, foot] = match thigh {
        Bone::LeftThigh => [Bone::LeftShin, Bone::LeftFoot],
        _ => [Bone::RightShin, Bone::RightFoot],
    };
    let joints = [thigh, shin, foot].map(|bone| avatar.bone_heads[bone]);
    let axis = |y: f64| {
        let [hip, knee, ankle] = joints;
        let [from, to] = if y > knee.y {
            [knee, hip]
        } else {
            [ankle, knee]
        };
        let t = ((y - from.y) / (to.y - from.y).max(1.0)).clamp(0.0, 1.0);
        let place = from.lerp(to, t);
        DVec2::new(place.x, place.z)
    };
    let points = places(avatar, |weight| weight.below(thigh) > 0.5);
    let polar = Polar::new(points.into_iter(), [marks.ankle_mm, marks.hip_mm], axis)?;
    let (high, low) = (marks.hip_mm, marks.trouser_hem_mm);
    let distances = polar.drape(|y| {
        let down = ((high - y) / (high - low).max(1.0)).clamp(0.0, 1.0);
        let thigh = LEG_EASE * garment.ease_mm;
        thigh + (garment.ease_mm.max(HEM_EASE_MM) - thigh) * down
    });
    Some(Drape { polar, distances })
}

/// Smooth upright folds
struct Folds {
    seed: u64,
    cell: DVec3,
}

impl Folds {
    fn new(seed: u64) -> Self {
        let [short, long] = FOLD_MM;
        let width = Random::new(seed ^ 0xf01d).between(short, long);
        Self {
            seed: seed ^ 0xf01d,
            cell: DVec3::new(width, FOLD_LENGTH * width, width),
        }
    }

    /// Returns the height of the folds at a point, -1 to 1
    fn at(&self, place: DVec3) -> f64 {
        2.0 * noise(place / self.cell, self.seed) - 1.0
    }
}

/// Returns unit normals that change slowly along the surface
fn smooth_normals(mesh: &TriMesh) -> Vec<DVec3> {
    let edges = mesh.edges();
    let mut normals = mesh.vertex_normals();
    for _ in 0..4 {
        let mut sums = normals.clone();
        for &[a, b] in &edges {
            let (a, b) = (a as usize, b as usize);
            sums[a] += normals[b];
            sums[b] += normals[a];
        }
        normals = sums.into_iter().map(DVec3::normalize_or_zero).collect();
    }
    normals
}

/// Moves points that lie inside the body to its surface
fn out_of_body(avatar: &Avatar, worn: &mut [DVec3]) {
    let winding = WindingNumbers::new(&avatar.mesh);
    let surface = NearestSurface::new(&avatar.mesh);
    for (point, place) in worn.iter_mut().zip(&avatar.mesh.positions) {
        if point != place
            && winding.at(*point) > 0.5
            && let Some(nearest) = surface.nearest(*point)
        {
            *point = nearest.position;
        }
    }
}

/// Puts shoes on the feet of an avatar that was lifted by the soles, down to the floor
pub(super) fn wear_shoes(avatar: &mut Avatar, marks: &Marks, sole_mm: f64) {
    if sole_mm <= 0.0 {
        return;
    }
    let normals = smooth_normals(&avatar.mesh);
    let top = marks.ankle_mm + 15.0;
    for ((place, weight), normal) in avatar
        .mesh
        .positions
        .iter_mut()
        .zip(&avatar.weights)
        .zip(&normals)
    {
        let barefoot = place.y - sole_mm;
        let share = weight.below(Bone::LeftShin) + weight.below(Bone::RightShin);
        if share < 0.5 || barefoot > top + HEM_STEP_MM {
            continue;
        }
        *place += *normal * SHOE_MM * (1.0 - cut(barefoot, top));
        // The sole has upright sides: the lowest part of the foot reaches down to the floor.
        place.y -= sole_mm * (1.0 - smooth_step(4.0, 16.0, barefoot));
        place.y = place.y.max(0.0);
    }
}
