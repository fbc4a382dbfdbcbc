//! Arguments of `eval` and its studies.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::MethodArgs;

/// Arguments of `eval`
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct EvalArgs {
    /// Another table than the published ones
    #[command(subcommand)]
    pub table: Option<EvalTable>,

    #[command(flatten)]
    pub published: EvalPublishedArgs,
}

/// Arguments of the published tables
#[derive(Debug, Args)]
pub struct EvalPublishedArgs {
    /// A look of less than a minute at few people, instead of all within ten minutes
    #[arg(long)]
    pub quick: bool,

    /// Exit with 1 and name each figure that falls short of what it must reach
    #[arg(long)]
    pub check: bool,

    /// Only these experiments
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = pirouette_eval::published::names())]
    pub only: Vec<String>,

    /// Folders of photos with truth, or folders of such folders, segmented and scored besides
    #[arg(long, value_name = "DIR", num_args = 1..)]
    pub photos: Vec<PathBuf>,

    /// Write a page with all pictures in it
    #[arg(long, value_name = "FILE.html")]
    pub html: Option<PathBuf>,

    /// Write a page whose pictures go to a folder of its name beside it
    #[arg(long, value_name = "FILE.md")]
    pub markdown: Option<PathBuf>,
}

/// What is evaluated
#[derive(Debug, Subcommand)]
pub enum EvalTable {
    /// Scan random people whose bodies are known: surface and girths by views and noise
    #[command(after_help = EVAL_BODIES_HELP)]
    Bodies(EvalBodiesArgs),
    /// Measure random people whose tape measures are known, and write the page docs/accuracy.md about it
    #[command(after_help = EVAL_TAPES_HELP)]
    Tapes(EvalTapesArgs),
    /// Scan photographed people with one part of the method off at a time
    #[command(after_help = EVAL_ABLATION_HELP)]
    Ablation(EvalAblationArgs),
    /// Scan folders that hold a `truth` folder, and score the results
    #[command(after_help = EVAL_SCANS_HELP)]
    Scans(EvalScansArgs),
    /// Segment single photos in folders that hold a `truth` folder, and score the silhouettes
    #[command(after_help = EVAL_PHOTOS_HELP)]
    Photos(EvalPhotosArgs),
}

/// Arguments of `eval bodies`
#[derive(Debug, Args)]
pub struct EvalBodiesArgs {
    /// People whose exact silhouettes are given [default: 40, with --quick 6]
    #[arg(long, value_name = "N")]
    pub people: Option<usize>,

    /// People who are photographed and segmented, in 8 views at noise 1 [default: 8, with --quick 2]
    #[arg(long, value_name = "N")]
    pub photo_people: Option<usize>,

    /// Numbers of views, each at the noise nearest to 1 [default: 4,6,8,9,12,16,36, with --quick 4,8]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = clap::value_parser!(u16).range(3..=72))]
    pub views: Option<Vec<u16>>,

    /// Errors of keypoints and turn angles, each at the number of views nearest to 8; 1 is what detectors do,
    /// 3 px at a stature of 800 px and 2 degrees [default: 0.5,1,2, with --quick 1]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = parse_noise)]
    pub noise: Option<Vec<f64>>,

    /// A look of about a minute instead of the whole study
    #[arg(long)]
    pub quick: bool,
}

/// Arguments of `eval tapes`
#[derive(Debug, Args)]
pub struct EvalTapesArgs {
    /// People, both from photos and by exact silhouettes; 30 of them at other numbers of views [default: 60, with --quick 4 and 2]
    #[arg(long, value_name = "N")]
    pub people: Option<usize>,

    /// Numbers of views, by exact silhouettes [default: 7,8,9,12,16,36, with --quick 8,9]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = clap::value_parser!(u16).range(3..=72))]
    pub views: Option<Vec<u16>>,

    /// Seed of the first person [default: 2001; the method was made with people below]
    #[arg(long, value_name = "N")]
    pub first_seed: Option<u64>,

    /// Folder for accuracy.md and its pictures; without it, the tables are printed only
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// A look of a minute instead of the whole study of a quarter of an hour
    #[arg(long)]
    pub quick: bool,
}

/// Arguments of `eval ablation`
#[derive(Debug, Args)]
pub struct EvalAblationArgs {
    /// People
    #[arg(long, value_name = "N", default_value_t = 6)]
    pub people: usize,

    /// Photos of each
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(3..=72))]
    pub views: u16,
}

/// Arguments of `eval scans`
#[derive(Debug, Args)]
pub struct EvalScansArgs {
    /// Scan folders with truth, or folders of such folders
    #[arg(value_name = "DIR", required = true)]
    pub folders: Vec<PathBuf>,

    /// Result folders go to OUT/<name of the scan folder>
    #[arg(short, long, value_name = "OUT", default_value = "eval-out")]
    pub out: PathBuf,

    /// Score what is in OUT already instead of scanning
    #[arg(long)]
    pub keep: bool,

    #[command(flatten)]
    pub method: MethodArgs,
}

/// Arguments of `eval photos`
#[derive(Debug, Args)]
pub struct EvalPhotosArgs {
    /// Folders of photos with truth, or folders of such folders
    #[arg(value_name = "DIR", required = true)]
    pub folders: Vec<PathBuf>,
}

/// A scale of errors
fn parse_noise(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(noise) if (0.0..=10.0).contains(&noise) => Ok(noise),
        _ => Err("must be a number from 0 to 10".to_owned()),
    }
}

pub const EVAL_HELP: &str = "\
Without a table: the results published by Zwettler et al. (VISAPP 2021), run again on rendered people, beside the
published figures, with what becomes of them when a part of the method is left out. All studies have fixed seeds.

Examples:
  pirouette eval --quick
  pirouette eval --check --html results.html
  pirouette eval --only registration,refinement --json
  pirouette eval --photos street
  pirouette eval bodies --quick
  pirouette eval ablation
  pirouette eval scans pirouette-demo/scan";

pub const EVAL_BODIES_HELP: &str = "\
Random women and men of body mass indices from 17 to 38, whose surfaces no mannequin has, sway and turn. Surface:
mean distance between found and true body, both ways, after a shift and a turn about the vertical. The last
row is of photos; the others are given exact silhouettes, which is faster. `--json` tells every person.

Examples:
  pirouette eval bodies --quick
  pirouette eval bodies --people 10 --views 8 --noise 0.5,1,2
  pirouette eval bodies --json > bodies.json";

pub const EVAL_TAPES_HELP: &str = "\
Bias, spread, mean and 90th percentile of the errors, repeatability, and whether the deviations told with the values are
honest, per measure; beside them limits and figures of others.

Examples:
  pirouette eval tapes --quick
  pirouette eval tapes -o docs
  pirouette eval tapes --people 20 --views 8,9,12 --json > tapes.json";

pub const EVAL_ABLATION_HELP: &str = "\
Examples:
  pirouette eval ablation
  pirouette eval ablation --people 2 --json";

pub const EVAL_SCANS_HELP: &str = "\
Truth: truth/<photo>_mask.png, and perhaps truth/<photo>_canonical.png (the person standing still in the reference
pose), truth/body.ply and truth/truth.json with measurements_mm. `pirouette demo` writes all of it.

Examples:
  pirouette eval scans pirouette-demo/scan
  pirouette eval scans scans/*                     scans every folder to eval-out, then scores
  pirouette eval scans scans/* -o results --keep   scores what results/<name> holds already";

pub const EVAL_PHOTOS_HELP: &str = "\
Truth: truth/<photo>_mask.png. Every photo is segmented for itself. A photo without a result counts as 0.

Examples:
  pirouette eval photos street
  pirouette eval photos photos/* --json";
