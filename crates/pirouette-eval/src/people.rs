//! Random people with known truth.
//!
//! A person is a mannequin of random sex, stature and mass whose surface is displaced by a random smooth field of its own:
//! no mannequin has that shape, so that a fit which starts from one has something to find. Field, bones and
//! keypoints move together. Left and right differ a little. And nobody stands like the mannequin: back, neck and legs are
//! held in a way of the person's own, about which the person sways.

use std::f64::consts::TAU;

use glam::DVec3;
use pirouette_body::Avatar;
use pirouette_body::Bone;
use pirouette_body::Sex;
use pirouette_body::mannequin::{MannequinError, MannequinParameters, mannequin};
use pirouette_synthetic::{
    Clutter, Random, SyntheticOptions, SyntheticScan, synthesize, with_posture,
};

/// Body mass indices of the people, evenly spread, in kg/m²
pub const BMI_RANGE: [f64; 2] = [17.0, 38.0];

/// Standard deviation of the stature within a sex, in mm
const STATURE_SD_MM: f64 = 65.0;

/// Statures are at most so many standard deviations from the mean
const MAX_STATURE_DEVIATION: f64 = 2.2;

/// Displacements that 99 % of a person's vertices stay below, evenly spread, in mm
const DISPLACEMENT_MM: [f64; 2] = [5.0, 15.0];

/// Wave lengths of the displacements, in mm
///
/// Shorter waves would be folds, longer ones shift the body as a whole.
const WAVE_LENGTH_MM: [f64; 2] = [300.0, 1200.0];

/// Waves in one field
const WAVE_COUNT: usize = 16;

/// Share of the field that differs between left and right
const LOPSIDED: f64 = 0.15;

/// Displacements up and down fade out below this height, so that soles stay flat, in mm
const SOLE_FADE_MM: f64 = 120.0;

/// Standard deviations of the bends of back, neck and head, in degrees
const POSTURE_DEGREES: [(Bone, f64); 4] = [
    (Bone::LowerSpine, 2.0),
    (Bone::UpperSpine, 1.5),
    (Bone::Neck, 3.0),
    (Bone::Head, 3.0),
];

/// ... of both hips, of both knees
const HIP_DEGREES: f64 = 1.5;
const KNEE_DEGREES: f64 = 1.5;

/// ... by which each leg stands farther apart
const APART_DEGREES: f64 = 1.5;

/// Columns and rows of the photos
const PHOTO_SIZE_PX: (usize, usize) = (800, 1000);

/// Noise of the keypoints at noise 1, in px at a stature of 800 px
pub const KEYPOINT_NOISE_PX: f64 = 3.0;

/// Error of the turn angles at noise 1, in degrees; bodies that sway turn about 3 degrees besides
pub const TURN_NOISE_DEGREES: f64 = 2.0;

/// Noise of the sensor, in gray levels
const SENSOR_NOISE: f64 = 2.0;

/// A random person
#[derive(Debug, Clone)]
pub struct Person {
    /// What the person is made from
    pub seed: u64,
    /// Whose proportions the mannequin had
    pub sex: Sex,
    /// Body mass index of the mannequin, in kg/m²
    pub bmi: f64,
    /// The body with its bones
    pub figure: Avatar,
}

impl Person {
    /// The person of a seed: women have even seeds, men odd ones
    ///
    /// # Errors
    /// When there is no such mannequin; that would be a fault of the mannequin.
    pub fn new(seed: u64) -> Result<Self, MannequinError> {
        let random = &mut Random::new(seed.wrapping_mul(0x9e6c_63d0_676a_9a99) ^ 0x7e09_1e5a);
        let sex = if seed.is_multiple_of(2) {
            Sex::Female
        } else {
            Sex::Male
        };
        let deviation = random
            .normal()
            .clamp(-MAX_STATURE_DEVIATION, MAX_STATURE_DEVIATION);
        let stature_mm = sex.mean_stature_mm() + STATURE_SD_MM * deviation;
        let bmi = random.between(BMI_RANGE[0], BMI_RANGE[1]);
        let mut figure = mannequin(&MannequinParameters {
            sex,
            stature_mm: Some(stature_mm),
            mass_kg: Some(bmi * (stature_mm / 1000.0).powi(2)),
            ..MannequinParameters::default()
        })?;
        displace(&mut figure, random);
        let figure = with_posture(&figure, &posture(random));
        Ok(Self {
            seed,
            sex,
            bmi,
            figure,
        })
    }

    /// Photographs the person with the usual sway; `noise` scales the errors of keypoints and turn angles
    ///
    /// Without `photos`, the exact silhouettes are given as masks.
    pub fn photograph(&self, view_count: usize, noise: f64, photos: bool) -> SyntheticScan {
        let (width_px, height_px) = PHOTO_SIZE_PX;
        synthesize(
            &self.figure,
            &SyntheticOptions {
                seed: self.seed,
                turns: SyntheticOptions::even_turns(view_count),
                camera: SyntheticOptions::camera_for(self.figure.stature_mm(), width_px, height_px),
                sway: 1.0,
                keypoint_noise_px: KEYPOINT_NOISE_PX * noise,
                turn_noise_radians: (TURN_NOISE_DEGREES * noise).to_radians(),
                sensor_noise: SENSOR_NOISE,
                clutter: Clutter::LivedIn,
                photos,
            },
        )
    }

    /// The person in a few words
    pub fn describe(&self) -> String {
        format!(
            "person {} ({}, {:.0} mm, BMI {:.0})",
            self.seed,
            self.sex.name(),
            self.figure.stature_mm(),
            self.bmi
        )
    }
}

/// A smooth random field of displacements: a sum of waves
struct Field {
    waves: Vec<Wave>,
}

struct Wave {
    /// Radians per mm
    number: DVec3,
    phase: f64,
    direction: DVec3,
}

impl Field {
    fn new(random: &mut Random) -> Self {
        let [short, long] = WAVE_LENGTH_MM.map(f64::ln);
        let vector =
            |random: &mut Random| DVec3::new(random.normal(), random.normal(), random.normal());
        let waves = (0..WAVE_COUNT)
            .map(|_| {
                let length_mm = random.between(short, long).exp();
                let along = vector(random).try_normalize().unwrap_or(DVec3::Y);
                Wave {
                    number: along * (TAU / length_mm),
                    phase: random.between(0.0, TAU),
                    direction: vector(random),
                }
            })
            .collect();
        Self { waves }
    }

    fn at(&self, point: DVec3) -> DVec3 {
        let waves = self.waves.iter();
        waves
            .map(|w| w.direction * (w.number.dot(point) + w.phase).sin())
            .sum()
    }

    /// Nearly the same on both sides
    fn balanced(&self, point: DVec3) -> DVec3 {
        let mirror = DVec3::new(-1.0, 1.0, 1.0);
        let (own, other) = (self.at(point), self.at(point * mirror) * mirror);
        let mut moved = own.lerp(other, (1.0 - LOPSIDED) / 2.0);
        moved.y *= (point.y / SOLE_FADE_MM).clamp(0.0, 1.0);
        moved
    }
}

/// Displaces surface, bones and keypoints by one random field
fn displace(figure: &mut Avatar, random: &mut Random) {
    let size_mm = random.between(DISPLACEMENT_MM[0], DISPLACEMENT_MM[1]);
    let field = Field::new(random);
    let lengths: Vec<f64> = figure
        .mesh
        .positions
        .iter()
        .map(|p| field.balanced(*p).length())
        .collect();
    let scale = match crate::table::percentile(&lengths, 0.99) {
        Some(large) if large > 0.0 => size_mm / large,
        _ => return,
    };
    let points = figure
        .mesh
        .positions
        .iter_mut()
        .chain(&mut figure.bone_heads)
        .chain(&mut figure.keypoints);
    for point in points {
        *point += field.balanced(*point) * scale;
    }
}

/// How a person stands, alike on both sides: bends about the x axis, legs apart; soles stay level
fn posture(random: &mut Random) -> Vec<(Bone, DVec3)> {
    let mut bend = |sd_degrees: f64| {
        let deviation = random.normal().clamp(-2.0, 2.0);
        (deviation * sd_degrees).to_radians()
    };
    let mut rotations: Vec<(Bone, DVec3)> = POSTURE_DEGREES
        .iter()
        .map(|&(bone, sd)| (bone, DVec3::X * bend(sd)))
        .collect();
    let (hip, knee, apart) = (bend(HIP_DEGREES), bend(KNEE_DEGREES), bend(APART_DEGREES));
    for (thigh, shin, foot, side) in [
        (Bone::LeftThigh, Bone::LeftShin, Bone::LeftFoot, 1.0),
        (Bone::RightThigh, Bone::RightShin, Bone::RightFoot, -1.0),
    ] {
        let apart = DVec3::Z * apart * side;
        rotations.push((thigh, DVec3::X * hip + apart));
        rotations.push((shin, DVec3::X * knee));
        rotations.push((foot, DVec3::NEG_X * (hip + knee) - apart));
    }
    rotations
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_is_one_person_and_another_seed_another() {
        let [a, b, c] = [4, 4, 5].map(|seed| Person::new(seed).unwrap());
        assert_eq!(a.figure.mesh, b.figure.mesh);
        assert_eq!((a.sex, c.sex), (Sex::Female, Sex::Male));
        a.figure.mesh.check().unwrap();
        a.figure.check().unwrap();
        assert!((BMI_RANGE[0]..BMI_RANGE[1]).contains(&a.bmi));
    }

    #[test]
    fn people_are_no_mannequins_but_nearly_symmetric() {
        let person = Person::new(6).unwrap();
        let plain = mannequin(&MannequinParameters {
            sex: person.sex,
            stature_mm: Some(person.figure.stature_mm()),
            mass_kg: Some(person.bmi * (person.figure.stature_mm() / 1000.0).powi(2)),
            ..MannequinParameters::default()
        })
        .unwrap();
        let error = crate::score::surface::surface_error(&plain.mesh, &person.figure.mesh).unwrap();
        assert!(
            error.mean_mm > 1.0 && error.mean_mm < 15.0,
            "{}",
            error.mean_mm
        );
        let mirrored = pirouette_geom::TriMesh {
            positions: person
                .figure
                .mesh
                .positions
                .iter()
                .map(|p| DVec3::new(-p.x, p.y, p.z))
                .collect(),
            triangles: person.figure.mesh.triangles.clone(),
        };
        let error = crate::score::surface::surface_error(&mirrored, &person.figure.mesh).unwrap();
        assert!(error.mean_mm < 3.0, "{}", error.mean_mm);
    }
}
