//! Arguments of `size`.

use std::path::PathBuf;

use clap::Args;

use super::Sex;

/// Arguments of `size`
#[derive(Debug, Args)]
pub struct SizeArgs {
    /// A result folder, or a measurements.json
    #[arg(value_name = "OUT")]
    pub out: PathBuf,

    /// Whose charts; both when neither this nor scan.json tells
    #[arg(long, value_enum)]
    pub sex: Option<Sex>,

    /// Size charts to use instead of the built-in ones
    #[arg(long, value_name = "FILE.toml")]
    pub chart: Option<PathBuf>,
}

pub const SIZE_HELP: &str = "\
One size, two neighboring ones, or \"not sure\", with probabilities from the deviations of the measures. The built-in charts
follow EN 13402-3. A chart of your own is a TOML file:
  [[chart]]
  name = \"Our shirts\"
  sex = \"female\"                        or \"male\"; for everybody without
  garment = \"top\"
  primary = \"bust_girth\"               any key of measurements.json
  secondary = [\"waist_girth\"]
  size = [
    { name = \"S\", bust_girth = [82, 90], waist_girth = [66, 74] },   in cm, of the body, small to large
    { name = \"M\", bust_girth = [90, 98], waist_girth = [74, 82] },
  ]

Examples:
  pirouette size anna
  pirouette size anna --sex female --chart shop.toml
  pirouette size anna/measurements.json --json";
