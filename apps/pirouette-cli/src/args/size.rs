//! Arguments of `size`.

use std::path::PathBuf;

use clap::Args;

use super::Sex;

/// Arguments of `size`
#[derive(Debug, Args)]
pub struct SizeArgs {
    /// Result folder or measurements.json file
    #[arg(value_name = "OUT")]
    pub out: PathBuf,

    /// Sex of the charts [default: that in scan.json, else both]
    #[arg(long, value_enum)]
    pub sex: Option<Sex>,

    /// Size charts to use instead of the built-in ones
    #[arg(long, value_name = "FILE.toml")]
    pub chart: Option<PathBuf>,
}

pub const SIZE_HELP: &str = "\
Prints one size, two adjacent sizes or \"not sure\", with probabilities derived from the standard deviations of the
measurements. All measures of a garment count: it must be large enough for each of them. If they indicate different
sizes, the line names the measure that decides. The built-in charts follow EN 13402-3. A custom chart is a TOML file:
  [[chart]]
  name = \"Our shirts\"
  sex = \"female\"                        or \"male\"; omit for all
  garment = \"top\"
  primary = \"bust_girth\"               any measure of measurements.json
  secondary = [\"waist_girth\"]
  size = [
    { name = \"S\", bust_girth = [82, 90], waist_girth = [66, 74] },   body dimensions in cm, ascending
    { name = \"M\", bust_girth = [90, 98], waist_girth = [74, 82] },
  ]
Intervals in whole centimeters may leave gaps of 1 cm ([82, 89], then [90, 97]).

Examples:
  pirouette size anna
  pirouette size anna --sex female --chart shop.toml
  pirouette size anna/measurements.json --json";
