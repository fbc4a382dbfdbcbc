//! Volume of the body, and the mass computed from it.

use super::{BodySource, MeasureInput};

/// Mass over volume of a person who breathes quietly, in kg/l: tissue of 1.05 kg/l, and three liters of air
const DENSITY_KG_PER_L: f64 = 0.99;

/// Standard deviation of the density over people, lean to fat, as a share
const DENSITY_SD: f64 = 0.015;

/// Standard deviation of the volume of a fitted body, as a share; that of a carved hull is as large as its excess
const FITTED_VOLUME_SD: f64 = 0.02;
const HULL_VOLUME_SD: f64 = 0.10;

/// Volume and mass of a body
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyMass {
    /// Volume of the body, in l
    pub volume_l: f64,
    /// Standard deviation of the volume
    pub volume_sd_l: f64,
    /// Mass by the volume, in kg
    pub mass_kg: f64,
    /// Standard deviation of the mass
    pub mass_sd_kg: f64,
    /// Mass given by the person, in kg
    pub stated_kg: Option<f64>,
}

/// Logarithm of the mass by the volume over the given one, above which they contradict each other
///
/// Four standard deviations of volume, density and stature.
const CONTRADICTION: f64 = 0.11;

impl BodyMass {
    /// Replaces volume and mass, which are those with clothes, by those of a body of a given build: mean and standard
    /// deviation of the square root of mass in kg over stature in m
    pub(super) fn set_build(&mut self, build: [f64; 2], stature_mm: f64) {
        let [mean, sd] = build;
        self.mass_kg = mean * mean * stature_mm / 1000.0;
        self.mass_sd_kg = 2.0 * sd / mean * self.mass_kg;
        self.volume_l = self.mass_kg / DENSITY_KG_PER_L;
        self.volume_sd_l = (2.0 * sd / mean).hypot(DENSITY_SD) * self.volume_l;
    }

    /// Returns the relative error of lengths that explains the difference from the given mass; 0 if the difference is
    /// plausible
    ///
    /// Mass grows with the cube of the stature; a wrong mass is as likely as a wrong stature.
    pub fn contradiction(&self) -> f64 {
        let Some(stated_kg) = self.stated_kg.filter(|&kg| kg > 0.0) else {
            return 0.0;
        };
        let log = (self.mass_kg / stated_kg).ln().abs();
        let plausible = CONTRADICTION.max(3.0 * self.mass_sd_kg / self.mass_kg);
        if log > plausible { log / 3.0 } else { 0.0 }
    }
}

/// Computes volume and mass; `None` without a body or without a scale
pub(super) fn estimate_mass(input: &MeasureInput, scale_sd: f64) -> Option<BodyMass> {
    let volume_l = input.body.volume() / 1e6;
    if input.stature_mm.is_none() || volume_l.is_nan() || volume_l <= 0.0 {
        return None;
    }
    let own = match input.source {
        BodySource::Fitted => FITTED_VOLUME_SD,
        BodySource::Hull => HULL_VOLUME_SD,
    };
    let share = own.hypot(3.0 * scale_sd);
    let mass_kg = DENSITY_KG_PER_L * volume_l;
    Some(BodyMass {
        volume_l,
        volume_sd_l: share * volume_l,
        mass_kg,
        mass_sd_kg: share.hypot(DENSITY_SD) * mass_kg,
        stated_kg: input.subject.mass_kg,
    })
}
