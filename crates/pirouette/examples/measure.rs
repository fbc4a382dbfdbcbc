//! Measures a body without photos: the built-in mannequin, along its own tapes.
//!
//! ```text
//! cargo run --release -p pirouette --example measure -- female 1680 61
//! ```
//!
//! Arguments: sex (female, male or neutral), stature in mm, body mass in kg.

#![allow(clippy::print_stdout, reason = "the example prints its results")]

use std::error::Error;

use pirouette::body::Sex;
use pirouette::body::mannequin::{MannequinParameters, mannequin};
use pirouette::measure::measure_avatar;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize| arguments.get(i).map(|text| text.parse()).transpose();
    let sex = match arguments.first().map(String::as_str) {
        Some("female") => Sex::Female,
        Some("male") => Sex::Male,
        Some("neutral") | None => Sex::Neutral,
        Some(other) => {
            return Err(format!("unknown sex {other}; use female, male or neutral").into());
        }
    };
    let body = mannequin(&MannequinParameters {
        sex,
        stature_mm: number(1)?,
        mass_kg: number(2)?,
        ..MannequinParameters::default()
    })?;
    for (measure, value_mm) in measure_avatar(&body) {
        println!(
            "{value_mm:7.1} mm  {:<24}  {}",
            measure.name(),
            measure.definition()
        );
    }
    Ok(())
}
