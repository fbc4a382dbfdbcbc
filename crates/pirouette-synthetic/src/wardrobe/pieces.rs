//! Closed pieces beside the body: the volume of hair, hats and skirts.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};
use pirouette_body::{Avatar, Bone, PerBone, SkinWeight};
use pirouette_geom::TriMesh;

use super::body::Marks;
use super::garments::places;
use super::polar::{ANGLES, Polar};
use super::{Bottom, Hair, Material, Outfit, Piece, smooth_step};
use crate::random::noise;

/// Radius of a bun, in mm
const BUN_MM: f64 = 40.0;

/// Radius of an afro relative to that of the skull
const AFRO: f64 = 1.35;

/// Height of a hat above the skull, its distance from the skull, and the width of its brim, in mm
const HAT_MM: f64 = 40.0;
const HAT_BESIDE_MM: f64 = 10.0;
const BRIM_MM: f64 = 55.0;

/// Thickness of long hair, in mm
const LONG_MM: f64 = 25.0;

/// Lower end of long hair below the shoulders, as a share of the stature
const LONG_BELOW: f64 = 0.1;

/// Distance between rings of long hair, in mm, and number of columns
const ROW_MM: f64 = 12.0;
const COLUMNS: usize = 17;

/// Joins rings with equal numbers of points to a closed surface, with a vertex at both ends
fn closed(rings: &[Vec<DVec3>], first: DVec3, last: DVec3) -> TriMesh {
    let count = rings.first().map_or(0, Vec::len) as u32;
    let mut positions: Vec<DVec3> = rings.iter().flatten().copied().collect();
    let first_pole = positions.len() as u32;
    positions.extend([first, last]);
    let mut triangles = Vec::new();
    let rows = rings.len() as u32;
    for k in 0..count {
        let next = (k + 1) % count;
        triangles.push([first_pole, k, next]);
        for row in 1..rows {
            let (low, high) = ((row - 1) * count, row * count);
            triangles.push([low + k, high + k, low + next]);
            triangles.push([low + next, high + k, high + next]);
        }
        let low = (rows - 1) * count;
        triangles.push([first_pole + 1, low + next, low + k]);
    }
    let mut mesh = TriMesh {
        positions,
        triangles,
    };
    if mesh.volume() < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    mesh
}

fn rigid(mesh: TriMesh, bone: Bone, material: Material) -> Piece {
    Piece {
        weights: vec![SkinWeight::rigid(bone); mesh.positions.len()],
        mesh,
        material,
    }
}

/// Returns a ball whose radius depends on the direction, in mm
fn ball(center: DVec3, radius: impl Fn(DVec3) -> f64) -> TriMesh {
    const ROWS: usize = 24;
    let at = |way: DVec3| center + way * radius(way);
    let rings: Vec<Vec<DVec3>> = (1..ROWS)
        .map(|row| {
            let (sin, cos) = (PI * row as f64 / ROWS as f64).sin_cos();
            let around = (0..2 * ROWS).map(|k| {
                let way = DVec2::from_angle(PI * k as f64 / ROWS as f64) * sin;
                at(DVec3::new(way.x, -cos, way.y))
            });
            around.collect()
        })
        .collect();
    closed(&rings, at(DVec3::NEG_Y), at(DVec3::Y))
}

/// Returns the pieces of hair or hat; `worn` are the clothed positions of the body
pub(super) fn hair(avatar: &Avatar, worn: &[DVec3], marks: &Marks, hair: Hair) -> Option<Piece> {
    let center = marks.skull_center();
    let [low, high] = marks.skull;
    match hair {
        Hair::Shaved => None,
        Hair::Bun => {
            let above = 0.45 * (high.y - marks.eyes.y);
            let middle = DVec3::new(center.x, marks.eyes.y + above, low.z - 0.6 * BUN_MM);
            let mesh = ball(middle, |_| BUN_MM);
            Some(rigid(mesh, Bone::Head, Material::Hair))
        }
        Hair::Afro => {
            let halves = marks.skull_halves();
            let radius = AFRO * (halves.x + halves.y) / 2.0;
            let middle = center + DVec3::new(0.0, 0.15, -0.1) * radius;
            let face = DVec3::new(0.0, -0.75, 1.0).normalize_or_zero();
            let mesh = ball(middle, |way| {
                // It leaves the face free.
                let open = smooth_step(0.72, 0.86, way.dot(face));
                let rough = 0.97 + 0.06 * noise(way * 9.0, 0xaf);
                radius * (rough * (1.0 - open) + 0.45 * open)
            });
            Some(rigid(mesh, Bone::Head, Material::Hair))
        }
        Hair::Hat => Some(rigid(hat(marks), Bone::Head, Material::Hat)),
        Hair::Long => long_hair(avatar, worn, marks),
    }
}

fn hat(marks: &Marks) -> TriMesh {
    let [low, high] = marks.skull;
    let middle = (low + high) / 2.0;
    let halves = marks.skull_halves() + DVec2::splat(HAT_BESIDE_MM);
    let brim = marks.eyes.y + 0.036 * marks.stature_mm;
    let top = high.y + HAT_MM;
    // Height, share of the crown's size, and what is added to it
    let profile = [
        (brim, 1.0, 0.0),
        (brim, 1.0, BRIM_MM),
        (brim + 4.0, 1.0, BRIM_MM),
        (brim + 5.0, 1.0, 2.0),
        ((brim + top) / 2.0, 0.97, 0.0),
        (top - 15.0, 0.92, 0.0),
        (top - 4.0, 0.84, 0.0),
        (top, 0.7, 0.0),
    ];
    let rings: Vec<Vec<DVec3>> = profile
        .iter()
        .map(|&(y, share, more)| {
            let around = (0..ANGLES).map(|k| {
                let way = DVec2::from_angle(TAU * k as f64 / ANGLES as f64);
                let at = way * (halves * share + DVec2::splat(more));
                DVec3::new(middle.x + at.x, y, middle.z + at.y)
            });
            around.collect()
        })
        .collect();
    let pole = |y: f64| DVec3::new(middle.x, y, middle.z);
    closed(&rings, pole(brim), pole(top))
}

/// Returns hair that hangs from the back of the head over neck and upper back
fn long_hair(avatar: &Avatar, worn: &[DVec3], marks: &Marks) -> Option<Piece> {
    let [low, high] = marks.skull;
    let half = (high.x - low.x) / 2.0 + 4.0;
    let top_mm = marks.eyes.y + 0.45 * (high.y - marks.eyes.y);
    let bottom_mm = marks.shoulder_mm - LONG_BELOW * marks.stature_mm;
    let rows = ((top_mm - bottom_mm) / ROW_MM).ceil().max(2.0) as usize;
    let middle_x = marks.skull_center().x;
    let column_x = |column: usize| half * (2.0 * column as f64 / (COLUMNS - 1) as f64 - 1.0);
    // The rearmost point of the body in each cell, from the lowest row
    let mut backs = vec![[f64::INFINITY; COLUMNS]; rows + 1];
    for (point, weight) in worn.iter().zip(&avatar.weights) {
        let arms = weight.below(Bone::LeftUpperArm) + weight.below(Bone::RightUpperArm);
        let row = ((point.y - bottom_mm) / ROW_MM).round();
        let column = ((point.x - middle_x) / half + 1.0) / 2.0 * (COLUMNS - 1) as f64;
        let inside = row >= 0.0 && row <= rows as f64 && column > -0.5;
        if arms < 0.5 && inside && column.round() < COLUMNS as f64 {
            let cell = &mut backs[row as usize][column.round() as usize];
            *cell = cell.min(point.z);
        }
    }
    // Columns beside the neck are as far back as the next one inside.
    let center = COLUMNS / 2;
    for row in &mut backs {
        for step in 1..=center {
            for (column, inner) in [
                (center - step, center - step + 1),
                (center + step, center + step - 1),
            ] {
                if !row[column].is_finite() {
                    row[column] = row[inner];
                }
            }
        }
    }
    // Hair hangs straight down from the head, and lies on what is farther back.
    for row in (0..rows).rev() {
        let above = backs[row + 1];
        for (own, above) in backs[row].iter_mut().zip(above) {
            *own = own.min(above + 0.15 * ROW_MM);
        }
    }
    for row in 1..=rows {
        let below = backs[row - 1];
        for (own, below) in backs[row].iter_mut().zip(below) {
            *own = own.min(below + 0.9 * ROW_MM);
        }
    }
    if !backs.iter().flatten().all(|z| z.is_finite()) {
        return None;
    }
    let place = |row: usize, column: usize, z: f64| {
        let x = middle_x + column_x(column);
        DVec3::new(x, bottom_mm + row as f64 * ROW_MM, z)
    };
    let rings: Vec<Vec<DVec3>> = (0..=rows)
        .map(|row| {
            // The upper end disappears in the hair on the skull, sides and the lower end are thinner.
            let end = smooth_step(0.0, 4.0, (rows - row) as f64)
                * (0.5 + 0.5 * smooth_step(0.0, 4.0, row as f64 + 1.0));
            let behind = (0..COLUMNS).map(|column| {
                let side = (column_x(column) / half).abs();
                let thick = LONG_MM * (1.0 - 0.7 * side.powi(4)) * end;
                place(row, column, backs[row][column] - thick - 1.0)
            });
            let before = (0..COLUMNS)
                .rev()
                .map(|column| place(row, column, backs[row][column] + 8.0));
            behind.chain(before).collect()
        })
        .collect();
    let pole = |row: usize| place(row, center, backs[row][center]);
    let mesh = closed(&rings, pole(0), pole(rows));
    let (from, to) = (marks.neck_mm, marks.neck_mm - 0.06 * marks.stature_mm);
    let weights = mesh.positions.iter().map(|p| {
        let head = smooth_step(to, from + 0.02 * marks.stature_mm, p.y);
        let mut all = PerBone::splat(0.0);
        (all[Bone::Head], all[Bone::UpperSpine]) = (head, 1.0 - head);
        SkinWeight::from_all(&all)
    });
    Some(Piece {
        weights: weights.collect(),
        mesh,
        material: Material::Hair,
    })
}

/// Returns the skirt of an outfit
pub(super) fn skirt(avatar: &Avatar, marks: &Marks, outfit: &Outfit, seed: u64) -> Option<Piece> {
    let Bottom::Skirt {
        ease_mm,
        flare,
        hem,
    } = outfit.bottom
    else {
        return None;
    };
    let hem_mm = marks.hip_mm + hem.clamp(0.1, 1.0) * (marks.ankle_mm - marks.hip_mm);
    let points = places(avatar, |weight| {
        weight.below(Bone::LeftUpperArm) + weight.below(Bone::RightUpperArm) < 0.3
    });
    let polar = Polar::new(points.into_iter(), [hem_mm, marks.waist_mm], |_| {
        marks.trunk_axis
    })?;
    let envelope = polar.envelope();
    let drape = polar.drape(|y| ease_mm * (1.0 - smooth_step(marks.hip_mm, marks.waist_mm, y)));
    let last = envelope.len() - 1;
    let rings: Vec<Vec<DVec3>> = (0..=last)
        .map(|level| {
            let y = polar.height_mm(level);
            let below_hip = (marks.hip_mm - y).max(0.0);
            let down = 1.0 - smooth_step(hem_mm, marks.hip_mm, y);
            let around = (0..ANGLES).map(|k| {
                let way = DVec2::from_angle(TAU * k as f64 / ANGLES as f64);
                let fold = noise(
                    DVec3::new(4.0 * way.x, y / 400.0, 4.0 * way.y),
                    seed ^ 0x5c1,
                ) - 0.5;
                let hang = below_hip * flare + 24.0 * fold * down;
                let hips = polar.radii[level][k] + drape[level][k];
                let loose = smooth_step(0.0, 60.0, below_hip);
                let radius = hips + (envelope[level][k].max(hips) - hips) * loose + hang.max(0.0);
                polar.point(level, k, radius + 3.0)
            });
            around.collect()
        })
        .collect();
    let pole = |level: usize| polar.point(level, 0, 0.0);
    let mesh = closed(&rings, pole(0), pole(last));
    Some(rigid(mesh, Bone::Root, Material::Skirt))
}
