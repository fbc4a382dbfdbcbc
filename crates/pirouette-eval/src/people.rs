//! Random people with known truth.
//!
//! A person is a mannequin of random sex, stature and mass whose surface is displaced by a separate random smooth
//! field. No mannequin has that shape, so a fit that starts from a mannequin has to change it. Surface, bones and
//! keypoints are displaced consistently. Left and right differ slightly. The posture of back, neck and legs differs
//! from that of the mannequin, too; the person sways about this posture.

use std::f64::consts::TAU;

use glam::DVec3;
use pirouette_body::mannequin::{MannequinError, MannequinParameters, mannequin};
use pirouette_body::{Avatar, Bone, ReferencePose, Sex};
use pirouette_synthetic::{
    Appearance, Clutter, Random, SyntheticOptions, SyntheticScan, synthesize, synthesize_in,
    with_posture,
};

/// Body mass indices of the people, uniformly distributed, in kg/m²
pub const BMI_RANGE: [f64; 2] = [17.0, 38.0];

/// Standard deviation of the stature within a sex, in mm
const STATURE_SD_MM: f64 = 65.0;

/// Largest deviation of a stature from the mean, in standard deviations
const MAX_STATURE_DEVIATION: f64 = 2.2;

/// 99th percentile of a person's displacements, uniformly distributed, in mm
const DISPLACEMENT_MM: [f64; 2] = [5.0, 15.0];

/// Wavelengths of the displacements, in mm
///
/// Shorter waves would cause folds, longer ones shift the complete body.
const WAVE_LENGTH_MM: [f64; 2] = [300.0, 1200.0];

/// Number of waves in one field
const WAVE_COUNT: usize = 16;

/// Share of the field that differs between left and right
const LOPSIDED: f64 = 0.15;

/// Vertical displacements fade out below this height, so that soles remain flat, in mm
const SOLE_FADE_MM: f64 = 120.0;

/// Standard deviations of the bends of back, neck and head, in degrees
const POSTURE_DEGREES: [(Bone, f64); 4] = [
    (Bone::LowerSpine, 2.0),
    (Bone::UpperSpine, 1.5),
    (Bone::Neck, 3.0),
    (Bone::Head, 3.0),
];

/// Standard deviation of the bends of both hips and of both knees
const HIP_DEGREES: f64 = 1.5;
const KNEE_DEGREES: f64 = 1.5;

/// Standard deviation of the angle by which each leg stands farther apart
const APART_DEGREES: f64 = 1.5;

/// Columns and rows of the photos
pub(crate) const PHOTO_SIZE_PX: (usize, usize) = (800, 1000);

/// Noise of the keypoints at noise 1, in px at a stature of 800 px
pub const KEYPOINT_NOISE_PX: f64 = 3.0;

/// Error of the turn angles at noise 1, in degrees; sway adds turns of about 3 degrees
pub const TURN_NOISE_DEGREES: f64 = 2.0;

/// Noise of the sensor, in gray levels
const SENSOR_NOISE: f64 = 2.0;

/// A random person
#[derive(Debug, Clone)]
pub struct Person {
    /// Seed of all random values
    pub seed: u64,
    /// Sex that determines the proportions of the mannequin
    pub sex: Sex,
    /// Body mass index of the mannequin, in kg/m²
    pub bmi: f64,
    /// The body with its bones
    pub avatar: Avatar,
}

impl Person {
    /// Creates the person of a seed: women have even seeds, men odd ones
    ///
    /// # Errors
    /// When the mannequin cannot be built, which would be a defect of the mannequin.
    pub fn new(seed: u64) -> Result<Self, MannequinError> {
        Self::holding(seed, ReferencePose::A, None)
    }

    /// Creates the person of a seed in a given pose; arms at another angle below the horizontal are optional
    ///
    /// # Errors
    /// As [`Person::new`].
    pub(crate) fn holding(
        seed: u64,
        pose: ReferencePose,
        arm_angle_degrees: Option<f64>,
    ) -> Result<Self, MannequinError> {
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
        let mut avatar = mannequin(&MannequinParameters {
            sex,
            stature_mm: Some(stature_mm),
            mass_kg: Some(bmi * (stature_mm / 1000.0).powi(2)),
            pose,
            arm_angle_degrees,
        })?;
        displace(&mut avatar, random);
        let avatar = with_posture(&avatar, &posture(random));
        Ok(Self {
            seed,
            sex,
            bmi,
            avatar,
        })
    }

    /// Photographs the person with default sway; `noise` scales the errors of keypoints and turn angles
    ///
    /// Without `photos`, the exact silhouettes are provided as masks.
    pub fn photograph(&self, view_count: usize, noise: f64, photos: bool) -> SyntheticScan {
        synthesize(&self.avatar, &self.options(view_count, noise, photos))
    }

    /// Photographs the person with default sway, exact turn angles, a given tone of the skin and a given light
    pub fn photograph_in(&self, view_count: usize, appearance: &Appearance) -> SyntheticScan {
        synthesize_in(
            &self.avatar,
            &self.options(view_count, 0.0, true),
            appearance,
        )
    }

    /// Returns the parameters of [`Person::photograph`]
    pub(crate) fn options(&self, view_count: usize, noise: f64, photos: bool) -> SyntheticOptions {
        let (width_px, height_px) = PHOTO_SIZE_PX;
        SyntheticOptions {
            seed: self.seed,
            turns: SyntheticOptions::even_turns(view_count),
            camera: SyntheticOptions::camera_for(self.avatar.stature_mm(), width_px, height_px),
            sway: 1.0,
            keypoint_noise_px: KEYPOINT_NOISE_PX * noise,
            turn_noise_radians: (TURN_NOISE_DEGREES * noise).to_radians(),
            sensor_noise: SENSOR_NOISE,
            clutter: Clutter::LivedIn,
            photos,
        }
    }

    /// Describes the person in a few words
    pub fn describe(&self) -> String {
        format!(
            "person {} ({}, {:.0} mm, BMI {:.0})",
            self.seed,
            self.sex.name(),
            self.avatar.stature_mm(),
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

    /// Evaluates the field, nearly symmetrically
    fn balanced(&self, point: DVec3) -> DVec3 {
        let mirror = DVec3::new(-1.0, 1.0, 1.0);
        let (own, other) = (self.at(point), self.at(point * mirror) * mirror);
        let mut moved = own.lerp(other, (1.0 - LOPSIDED) / 2.0);
        moved.y *= (point.y / SOLE_FADE_MM).clamp(0.0, 1.0);
        moved
    }
}

/// Displaces surface, bones and keypoints by one random field
fn displace(avatar: &mut Avatar, random: &mut Random) {
    let size_mm = random.between(DISPLACEMENT_MM[0], DISPLACEMENT_MM[1]);
    let field = Field::new(random);
    let lengths: Vec<f64> = avatar
        .mesh
        .positions
        .iter()
        .map(|p| field.balanced(*p).length())
        .collect();
    let scale = match crate::table::percentile(&lengths, 0.99) {
        Some(large) if large > 0.0 => size_mm / large,
        _ => return,
    };
    let points = avatar
        .mesh
        .positions
        .iter_mut()
        .chain(&mut avatar.bone_heads)
        .chain(&mut avatar.keypoints);
    for point in points {
        *point += field.balanced(*point) * scale;
    }
}

/// Returns a symmetric posture: bends about the x axis, legs apart; soles remain level
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
    fn seeds_determine_the_person() {
        let [a, b, c] = [4, 4, 5].map(|seed| Person::new(seed).unwrap());
        assert_eq!(a.avatar.mesh, b.avatar.mesh);
        assert_eq!((a.sex, c.sex), (Sex::Female, Sex::Male));
        a.avatar.mesh.check().unwrap();
        a.avatar.check().unwrap();
        assert!((BMI_RANGE[0]..BMI_RANGE[1]).contains(&a.bmi));
    }

    #[test]
    fn people_differ_from_mannequins_and_are_nearly_symmetric() {
        let person = Person::new(6).unwrap();
        let plain = mannequin(&MannequinParameters {
            sex: person.sex,
            stature_mm: Some(person.avatar.stature_mm()),
            mass_kg: Some(person.bmi * (person.avatar.stature_mm() / 1000.0).powi(2)),
            ..MannequinParameters::default()
        })
        .unwrap();
        let error = crate::score::surface::surface_error(&plain.mesh, &person.avatar.mesh).unwrap();
        assert!(
            error.mean_mm > 1.0 && error.mean_mm < 15.0,
            "{}",
            error.mean_mm
        );
        let mirrored = pirouette_geom::TriMesh {
            positions: person
                .avatar
                .mesh
                .positions
                .iter()
                .map(|p| DVec3::new(-p.x, p.y, p.z))
                .collect(),
            triangles: person.avatar.mesh.triangles.clone(),
        };
        let error = crate::score::surface::surface_error(&mirrored, &person.avatar.mesh).unwrap();
        assert!(error.mean_mm < 3.0, "{}", error.mean_mm);
    }
}
