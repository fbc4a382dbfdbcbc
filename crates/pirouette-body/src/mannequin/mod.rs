//! The built-in parametric mannequin: a person of a given sex, stature and mass in the reference pose.
//!
//! Heights, breadths, depths and girths follow regressions on the ANSUR II survey. The body is an implicit surface:
//! tubes of anatomical sections blended with lobes for breasts, seat, shoulders, face, hands and feet. The section
//! sizes are solved until the tape measures agree with the survey; then one closed, exactly symmetric mesh is
//! extracted.
//!
//! Guaranteed: closed and manifold, one piece, soles on y = 0, stature exact. Not modeled: facial features beyond brow,
//! eye sockets, nose, lips and chin; nails; hair.

mod extremities;
mod field;
mod frame;
mod girth;
mod head;
mod limbs;
mod primitives;
mod proportions;
mod shape;
mod surface;
mod trunk;
mod weights;

#[cfg(test)]
mod tests;

use glam::DVec3;
use pirouette_geom::TriMesh;
use pirouette_geom::parallel::prelude::*;
use thiserror::Error;

use self::extremities::FootPlan;
use self::field::{Field, ramp};
use self::frame::{ArmPose, Frame};
use self::girth::fit_girths;
pub use self::proportions::Proportions;
use self::shape::{Anatomy, GirthScales, LEAN_BMI, build};
use self::surface::{Grid, Lenses, extract};
use self::weights::skin_weight;
use crate::{Avatar, Joint, PerJoint, ReferencePose, Sex};

/// Proportions and stance of a mannequin
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MannequinParameters {
    /// Sex whose proportions are used
    pub sex: Sex,
    /// Height, in mm; the mean of the sex when not given
    pub stature_mm: Option<f64>,
    /// Body mass, in kg; a body mass index of [`DEFAULT_BMI`] when not given
    pub mass_kg: Option<f64>,
    /// Reference pose in which it stands
    pub pose: ReferencePose,
    /// Upper arms below the horizontal, in degrees; the angle of `pose` when not given
    pub arm_angle_degrees: Option<f64>,
}

/// Body mass index of a mannequin whose mass is not given, in kg/m^2
///
/// The middle of the range that counts as normal weight. The survey's soldiers average 25.5 (women) and 27.7 (men),
/// with more muscle than other people.
pub const DEFAULT_BMI: f64 = 22.0;

/// Accepted statures, in mm
pub const STATURE_RANGE_MM: [f64; 2] = [500.0, 3000.0];

/// Accepted body mass indices, in kg/m^2
pub const BMI_RANGE: [f64; 2] = [11.0, 75.0];

/// Accepted arm angles, in degrees below the horizontal; lower arms would merge with the hips
pub const ARM_ANGLE_RANGE_DEGREES: [f64; 2] = [-30.0, 75.0];

/// Statures for which the regressions are valid, in mm; other bodies are scaled copies
const REGRESSION_STATURE_MM: [f64; 2] = [1300.0, 2150.0];

/// Body mass indices for which the regressions give consistent shapes, in kg/m^2
const REGRESSION_BMI: [f64; 2] = [14.0, 50.0];

/// Why a mannequin cannot be built
#[derive(Debug, Clone, PartialEq, Error)]
#[allow(missing_docs, reason = "the messages document the variants")]
#[non_exhaustive]
pub enum MannequinError {
    #[error("stature of {stature_mm} mm is outside {} to {} mm", STATURE_RANGE_MM[0], STATURE_RANGE_MM[1])]
    Stature { stature_mm: f64 },
    #[error("mass of {mass_kg} kg at a stature of {stature_mm:.0} mm is outside a body mass index of {} to {} kg/m^2", BMI_RANGE[0], BMI_RANGE[1])]
    Mass { mass_kg: f64, stature_mm: f64 },
    #[error("arm angle of {degrees} degrees is outside {} to {} degrees below the horizontal", ARM_ANGLE_RANGE_DEGREES[0], ARM_ANGLE_RANGE_DEGREES[1])]
    ArmAngle { degrees: f64 },
    #[error(
        "no closed surface could be extracted for a stature of {stature_mm:.0} mm and a mass of {mass_kg:.1} kg"
    )]
    Surface { stature_mm: f64, mass_kg: f64 },
}

/// Parameters that passed the checks
#[derive(Debug, Clone, Copy)]
struct Checked {
    sex: Sex,
    stature_mm: f64,
    mass_kg: f64,
    arms: ArmPose,
}

impl MannequinParameters {
    fn check(&self) -> Result<Checked, MannequinError> {
        let within = |x: f64, [lo, hi]: [f64; 2]| x >= lo && x <= hi;
        let stature_mm = self.stature_mm.unwrap_or(self.sex.mean_stature_mm());
        if !within(stature_mm, STATURE_RANGE_MM) {
            return Err(MannequinError::Stature { stature_mm });
        }
        let stature_m = stature_mm / 1000.0;
        let mass_kg = self.mass_kg.unwrap_or(DEFAULT_BMI * stature_m * stature_m);
        if !within(mass_kg / (stature_m * stature_m), BMI_RANGE) {
            return Err(MannequinError::Mass {
                mass_kg,
                stature_mm,
            });
        }
        let degrees = self
            .arm_angle_degrees
            .unwrap_or(self.pose.arm_angle_degrees());
        if !within(degrees, ARM_ANGLE_RANGE_DEGREES) {
            return Err(MannequinError::ArmAngle { degrees });
        }
        Ok(Checked {
            sex: self.sex,
            stature_mm,
            mass_kg,
            arms: ArmPose {
                below_radians: degrees.to_radians(),
                elbow_bend_radians: self.pose.elbow_bend_degrees().to_radians(),
            },
        })
    }
}

/// Builds the mannequin
///
/// # Errors
/// When a parameter is not a number or out of bounds; every other input succeeds.
pub fn mannequin(parameters: &MannequinParameters) -> Result<Avatar, MannequinError> {
    build_avatar(parameters, 1.0)
}

/// Builds the mannequin on a coarse mesh, in a quarter of the time
///
/// The same body with merged fingers: sufficient to evaluate how well its proportions fit.
///
/// # Errors
/// Same as [`mannequin`].
pub fn coarse_mannequin(parameters: &MannequinParameters) -> Result<Avatar, MannequinError> {
    build_avatar(parameters, COARSE_SPACING)
}

/// Builds the mannequin on a grid whose planes are `spacing` times as far apart as usual
fn build_avatar(parameters: &MannequinParameters, spacing: f64) -> Result<Avatar, MannequinError> {
    let checked = parameters.check()?;
    let body = Body::new(&checked);
    let mesh = body.surface(spacing).ok_or(MannequinError::Surface {
        stature_mm: checked.stature_mm,
        mass_kg: checked.mass_kg,
    })?;
    let heads = body.frame.bone_heads();
    let weights = mesh
        .positions
        .par_iter()
        .map(|&p| skin_weight(&body.field, &body.frame, &heads, p))
        .collect();
    let avatar = Avatar {
        keypoints: body.keypoints(),
        mesh,
        weights,
        bone_heads: heads,
        pose: parameters.pose,
    };
    let top = avatar.mesh.bounds().map_or(1.0, |(_, hi)| hi.y);
    Ok(avatar.scaled(checked.stature_mm / top))
}

/// Distance between grid corners on the hands, in thousandths of the stature
///
/// With a wider spacing the gaps between the fingers close; each 10 % less costs 400 vertices.
const HAND_SPACING: f64 = 3.3;

/// Ratio of the plane distance of a [`coarse_mannequin`] to that of a mannequin
const COARSE_SPACING: f64 = 2.0;

/// Number of grids tried before failing; one in a few hundred bodies needs the second
const GRID_ATTEMPTS: usize = 4;

/// The implicit body with the dimensions that it follows
struct Body {
    dimensions: Proportions,
    frame: Frame,
    field: Field,
}

impl Body {
    fn new(checked: &Checked) -> Self {
        let stature_mm = checked
            .stature_mm
            .clamp(REGRESSION_STATURE_MM[0], REGRESSION_STATURE_MM[1]);
        let bmi = checked.mass_kg / (checked.stature_mm / 1000.0).powi(2);
        let mass = |bmi: f64| bmi * (stature_mm / 1000.0).powi(2);
        let bmi = bmi.clamp(REGRESSION_BMI[0], REGRESSION_BMI[1]);
        let dimensions = Proportions::regressed(checked.sex, stature_mm, mass(bmi));
        let lean = Proportions::regressed(checked.sex, stature_mm, mass(LEAN_BMI));
        let frame = Frame::new(
            &dimensions,
            checked.sex.maleness(),
            stature_mm,
            checked.arms,
        );
        let unscaled = Anatomy {
            maleness: checked.sex.maleness(),
            dimensions: &dimensions,
            lean: &lean,
            frame: &frame,
            scales: &GirthScales::default(),
        };
        let scales = fit_girths(&unscaled);
        let field = build(&Anatomy {
            scales: &scales,
            ..unscaled
        });
        Self {
            field,
            dimensions,
            frame,
        }
    }

    /// Extracts the closed surface; the grid is shifted slightly when the first one intersects the surface badly
    fn surface(&self, spacing: f64) -> Option<TriMesh> {
        (0..GRID_ATTEMPTS).find_map(|attempt| {
            let grid = self.grid(attempt as f64 / GRID_ATTEMPTS as f64, spacing);
            let mesh = extract(&self.field, &grid, self.frame.tragion)?.largest_component();
            mesh.check().is_ok().then_some(mesh)
        })
    }

    /// Grid: about 16 mm apart on trunk and limbs, 6 mm on the hands, 9 mm on head and feet
    ///
    /// `shift` moves its planes by a share of their distance, which is `widening` times the usual one.
    fn grid(&self, shift: f64, widening: f64) -> Grid {
        let (m, frame) = (self.frame.permille_mm, &self.frame);
        let (lo, hi) = self.field.bounds();
        let planes = |from: f64, to: f64, spacing: &dyn Fn(f64) -> f64| -> Vec<f64> {
            let mut planes = vec![from];
            let mut at = from;
            while at < to {
                at += widening * spacing(at);
                planes.push(at);
            }
            planes
        };
        // Spacing changes gradually; a hand that points steeply down is short along x.
        let steepness = (frame.forearm_axes.y_axis.x / 0.45).clamp(0.3, 1.0);
        let close = |x: f64| ramp(x, frame.elbow.x, frame.wrist.x);
        let half = planes((3.2 + 0.5 * shift) * widening * m, hi.x, &|x| {
            (9.0 + (HAND_SPACING * steepness - 9.0) * close(x)) * m
        });
        let x = half.iter().rev().map(|x| -x).chain(half.iter().copied());
        let chin = frame.tragion.y - 70.0 * m;
        // Extends beyond the bounds by the distance that the lenses may bend inward.
        let beyond = 140.0 * m;
        Grid {
            x: x.collect(),
            y: planes(
                lo.y.min(-20.0 * m) - 4.6 * shift * widening * m,
                hi.y + beyond,
                &|y| {
                    let feet = 1.0 - ramp(y, 30.0 * m, 90.0 * m);
                    let head = ramp(y, chin - 20.0 * m, chin + 20.0 * m);
                    (9.2 - 4.6 * feet - 4.6 * head) * m
                },
            ),
            z: planes(
                lo.z - beyond - 8.4 * shift * widening * m,
                hi.z + beyond,
                &|_| 8.4 * m,
            ),
            lenses: Lenses {
                forearm: [frame.elbow, frame.wrist],
                hand_scale: 1.0 - (1.0 - HAND_SPACING / 8.8) * ((steepness - 0.3) / 0.7),
                neck: [frame.nape.y - 20.0 * m, frame.nape.y + 40.0 * m],
                head_z: frame.tragion.z,
                head_scale: 0.54,
                head_reach: [100.0 * m, 220.0 * m],
                ankle: [30.0 * m, 100.0 * m],
                foot_z: frame.ankle.z + 35.0 * m,
                foot_scale: 0.70,
            },
        }
    }

    fn keypoints(&self) -> PerJoint<DVec3> {
        let (d, frame) = (&self.dimensions, &self.frame);
        let m = frame.permille_mm;
        let crown = frame.tragion.y + d.crown_to_tragion;
        let foot = FootPlan::new(d, frame);
        let ahead = |x: f64, depth: f64| {
            let from = DVec3::new(x, crown - depth * d.crown_to_tragion, frame.tragion.z);
            self.field.exit(from, DVec3::Z)
        };
        let left = |joint: Joint| -> DVec3 {
            match joint {
                Joint::Nose => ahead(0.0, 1.20),
                Joint::Neck => DVec3::new(0.0, frame.shoulder.y, frame.shoulder.z),
                Joint::LeftShoulder => frame.shoulder,
                Joint::LeftElbow => frame.elbow,
                Joint::LeftWrist => frame.wrist,
                Joint::MidHip => DVec3::new(0.0, frame.hip.y, frame.hip.z),
                Joint::LeftHip => frame.hip,
                Joint::LeftKnee => frame.knee,
                Joint::LeftEye => ahead(d.eye_distance / 2.0, 0.93),
                Joint::LeftEar => self.field.exit(frame.tragion, DVec3::X),
                Joint::LeftBigToe => self.field.exit(foot.at(-0.62, 0.90, 8.0 * m), DVec3::Z),
                Joint::LeftSmallToe => self.field.exit(foot.at(0.75, 0.80, 6.0 * m), DVec3::Z),
                Joint::LeftHeel => self.field.exit(foot.at(0.0, 0.1, 12.0 * m), DVec3::NEG_Z),
                _ => frame.ankle,
            }
        };
        PerJoint::from_fn(|joint| {
            if joint.name().starts_with("right") {
                let p = left(joint.mirrored());
                DVec3::new(-p.x, p.y, p.z)
            } else {
                left(joint)
            }
        })
    }
}
