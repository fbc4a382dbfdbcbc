//! Builds the implicit surface of a person from dimensions and joints.
//!
//! The anatomy is encoded in the tables of this module and its neighbors: heights, radii and shifts of sections, in per
//! permille_mm of the stature for the trunk and in multiples of the girth's radius for the limbs, modeled on standing adults
//! of average weight. Mass changes them by the survey's breadths and depths; [`GirthScales`] then brings the tape
//! measures to their exact values.

use super::extremities::{add_foot, add_hand};
use super::field::Field;
use super::frame::Frame;
use super::head::add_head;
use super::limbs::{add_arm, add_leg};
use super::proportions::Proportions;
use super::trunk::add_trunk;
use crate::Sex;

/// Inputs from which every part of the body is built
#[derive(Debug)]
pub(super) struct Anatomy<'a> {
    /// 0 female, 1 male
    pub maleness: f64,
    pub dimensions: &'a Proportions,
    /// Dimensions of the same person at the weight that the tables describe
    pub lean: &'a Proportions,
    pub frame: &'a Frame,
    pub scales: &'a GirthScales,
}

impl Anatomy<'_> {
    /// Interpolates between a female and a male value
    pub(super) fn by_sex(&self, female: f64, male: f64) -> f64 {
        female + (male - female) * self.maleness
    }
}

/// Body mass index (kg/m^2) of the people whose sections the tables describe
pub(super) const LEAN_BMI: f64 = 22.0;

impl Sex {
    /// Returns 0 for female, 1 for male, and the value between for neutral
    pub(super) fn maleness(self) -> f64 {
        match self {
            Sex::Female => 0.0,
            Sex::Neutral => 0.5,
            Sex::Male => 1.0,
        }
    }
}

/// Factors on the sections near each tape, determined by measuring
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(missing_docs, reason = "the names are self-explanatory")]
pub(super) struct GirthScales {
    pub neck: f64,
    pub chest: f64,
    pub waist: f64,
    pub hip: f64,
    pub thigh: f64,
    pub knee: f64,
    pub calf: f64,
    pub ankle: f64,
    pub upper_arm: f64,
    pub forearm: f64,
    pub wrist: f64,
}

impl Default for GirthScales {
    fn default() -> Self {
        Self {
            neck: 1.0,
            chest: 1.0,
            waist: 1.0,
            hip: 1.0,
            thigh: 1.0,
            knee: 1.0,
            calf: 1.0,
            ankle: 1.0,
            upper_arm: 1.0,
            forearm: 1.0,
            wrist: 1.0,
        }
    }
}

/// Builds the complete body
pub(super) fn build(anatomy: &Anatomy) -> Field {
    let mut field = Field::default();
    add_trunk(&mut field, anatomy);
    add_leg(&mut field, anatomy);
    add_foot(&mut field, anatomy);
    add_head(&mut field, anatomy);
    add_arm(&mut field, anatomy);
    add_hand(&mut field, anatomy);
    field
}
