//! Arguments of `eval` and its studies.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use pirouette_eval::faults::Group;

use super::MethodArgs;

/// Arguments of `eval`
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct EvalArgs {
    /// Study to run instead of the published experiments
    #[command(subcommand)]
    pub table: Option<EvalTable>,

    #[command(flatten)]
    pub published: EvalPublishedArgs,
}

/// Arguments of the published experiments
#[derive(Debug, Args)]
pub struct EvalPublishedArgs {
    /// Use fewer people: less than a minute instead of up to ten
    #[arg(long)]
    pub quick: bool,

    /// Exit with 1 and list the results that miss their goals
    #[arg(long)]
    pub check: bool,

    /// Run only these experiments
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = pirouette_eval::published::names())]
    pub only: Vec<String>,

    /// Also segment and score these folders of photos with ground truth, or folders of such folders
    #[arg(long, value_name = "DIR", num_args = 1..)]
    pub photos: Vec<PathBuf>,

    /// Write a page with embedded pictures
    #[arg(long, value_name = "FILE.html")]
    pub html: Option<PathBuf>,

    /// Write a page; its pictures go to a folder of the same name beside it
    #[arg(long, value_name = "FILE.md")]
    pub markdown: Option<PathBuf>,
}

/// Studies
#[derive(Debug, Subcommand)]
pub enum EvalTable {
    /// Scan random people with known bodies: surface and girth errors by number of views and noise
    #[command(after_help = EVAL_BODIES_HELP)]
    Bodies(EvalBodiesArgs),
    /// Measure random people with known tape measurements; writes docs/accuracy.md with `-o docs`
    #[command(after_help = EVAL_TAPES_HELP)]
    Tapes(EvalTapesArgs),
    /// Scan random people with mistakes in the input: refused, corrected, right or wrong; writes docs/faults.md with `-o docs`
    #[command(after_help = EVAL_FAULTS_HELP)]
    Faults(EvalFaultsArgs),
    /// Scan rendered photos with one part of the method disabled at a time
    #[command(after_help = EVAL_ABLATION_HELP)]
    Ablation(EvalAblationArgs),
    /// Scan random people at unknown turn angles: errors of the angles found; writes docs/angles.md with `-o docs`
    #[command(after_help = EVAL_ANGLES_HELP)]
    Angles(EvalAnglesArgs),
    /// Scan random people with hair, shoes and clothes: errors against the naked body; writes clothes.md with `-o DIR`
    #[command(after_help = EVAL_CLOTHES_HELP)]
    Clothes(EvalClothesArgs),
    /// Film random people and scan the videos: errors of angles and girths; writes docs/videos.md with `-o docs`
    #[command(after_help = EVAL_VIDEOS_HELP)]
    Videos(EvalVideosArgs),
    /// Scan folders that contain a `truth` folder, and score the results
    #[command(after_help = EVAL_SCANS_HELP)]
    Scans(EvalScansArgs),
    /// Segment single photos in folders that contain a `truth` folder, and score the silhouettes
    #[command(after_help = EVAL_PHOTOS_HELP)]
    Photos(EvalPhotosArgs),
}

/// Arguments of `eval bodies`
#[derive(Debug, Args)]
pub struct EvalBodiesArgs {
    /// People scanned from exact silhouettes [default: 40, with --quick 6]
    #[arg(long, value_name = "N")]
    pub people: Option<usize>,

    /// People scanned from rendered photos, in 8 views at noise 1 [default: 8, with --quick 2]
    #[arg(long, value_name = "N")]
    pub photo_people: Option<usize>,

    /// Numbers of views, each at the noise nearest to 1 [default: 4,6,8,9,12,16,36, with --quick 4,8]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = clap::value_parser!(u16).range(3..=72))]
    pub views: Option<Vec<u16>>,

    /// Noise levels of keypoints and turn angles, each at the number of views nearest to 8; 1 is typical of detectors:
    /// 3 px at a stature of 800 px, and 2 degrees [default: 0.5,1,2, with --quick 1]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = parse_noise)]
    pub noise: Option<Vec<f64>>,

    /// Run a small study of about a minute
    #[arg(long)]
    pub quick: bool,
}

/// Arguments of `eval tapes`
#[derive(Debug, Args)]
pub struct EvalTapesArgs {
    /// People, scanned from photos and from exact silhouettes; 30 of them at other numbers of views
    /// [default: 60, with --quick 4 and 2]
    #[arg(long, value_name = "N")]
    pub people: Option<usize>,

    /// Numbers of views, from exact silhouettes [default: 7,8,9,12,16,36, with --quick 8,9]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = clap::value_parser!(u16).range(3..=72))]
    pub views: Option<Vec<u16>>,

    /// Seed of the first person [default: 2001; smaller seeds were used for development]
    #[arg(long, value_name = "N")]
    pub first_seed: Option<u64>,

    /// Folder for accuracy.md and its pictures; if omitted, the tables are only printed
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Run a small study of a minute instead of a quarter of an hour
    #[arg(long)]
    pub quick: bool,
}

/// Arguments of `eval faults`
#[derive(Debug, Args)]
pub struct EvalFaultsArgs {
    /// Number of people
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub people: usize,

    /// Leave out the first N people, to study others
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub skip: usize,

    /// Photos per person
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(4..=72))]
    pub views: u16,

    /// Run only the faults of these groups
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = Group::ALL.map(Group::name))]
    pub only: Vec<String>,

    /// Scan nothing, but join the results of other people, each written by `eval faults --skip N --json`
    #[arg(long, value_name = "FILES", value_delimiter = ',', conflicts_with_all = ["people", "skip", "views", "only"])]
    pub join: Vec<PathBuf>,

    /// Folder for faults.md; if omitted, the tables are only printed
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `eval ablation`
#[derive(Debug, Args)]
pub struct EvalAblationArgs {
    /// Number of people
    #[arg(long, value_name = "N", default_value_t = 6)]
    pub people: usize,

    /// Photos per person
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(3..=72))]
    pub views: u16,
}

/// Arguments of `eval angles`
#[derive(Debug, Args)]
pub struct EvalAnglesArgs {
    /// Number of people
    #[arg(long, value_name = "N", default_value_t = 12)]
    pub people: usize,

    /// Photos per person
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(4..=72))]
    pub views: u16,

    /// Folder for angles.md; if omitted, the tables are only printed
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `eval clothes`
#[derive(Debug, Args)]
pub struct EvalClothesArgs {
    /// Number of people, each in nine outfits
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub people: usize,

    /// Seed of the first person
    #[arg(long, value_name = "N", default_value_t = pirouette_eval::clothes::FIRST_SEED)]
    pub first_seed: u64,

    /// Folder for clothes.md; if omitted, the tables are only printed
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `eval videos`
#[derive(Debug, Args)]
pub struct EvalVideosArgs {
    /// Number of people, in four videos each
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub people: usize,

    /// Folder of the videos; those that are there are not rendered again
    #[arg(long, value_name = "DIR", default_value = "eval-videos")]
    pub videos: PathBuf,

    /// Network of the pose detector [default: the installed one]
    #[arg(long, value_name = "FILE")]
    pub pose_model: Option<PathBuf>,

    /// Folder for videos.md; if omitted, the table is only printed
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Arguments of `eval scans`
#[derive(Debug, Args)]
pub struct EvalScansArgs {
    /// Scan folders with ground truth, or folders of such folders
    #[arg(value_name = "DIR", required = true)]
    pub folders: Vec<PathBuf>,

    /// Results are written to OUT/<name of the scan folder>
    #[arg(short, long, value_name = "OUT", default_value = "eval-out")]
    pub out: PathBuf,

    /// Score the existing results in OUT instead of scanning
    #[arg(long)]
    pub keep: bool,

    #[command(flatten)]
    pub method: MethodArgs,
}

/// Arguments of `eval photos`
#[derive(Debug, Args)]
pub struct EvalPhotosArgs {
    /// Folders of photos with ground truth, or folders of such folders
    #[arg(value_name = "DIR", required = true)]
    pub folders: Vec<PathBuf>,
}

/// Parses a noise level
fn parse_noise(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(noise) if (0.0..=10.0).contains(&noise) => Ok(noise),
        _ => Err("must be a number from 0 to 10".to_owned()),
    }
}

pub const EVAL_HELP: &str = "\
Without a study: reproduces the experiments of Zwettler et al. (VISAPP 2021) on rendered people and compares the results
with the published ones, including ablations of parts of the method. All studies use fixed seeds.

Examples:
  pirouette eval --quick
  pirouette eval --check --html results.html
  pirouette eval --only registration,refinement --json
  pirouette eval --photos street
  pirouette eval bodies --quick
  pirouette eval ablation
  pirouette eval scans pirouette-demo/scan";

pub const EVAL_BODIES_HELP: &str = "\
Random swaying women and men with body mass indices from 17 to 38, whose surfaces differ from any mannequin. Surface
error: mean distance between estimated and true body, in both directions, after alignment by a shift and a turn about
the vertical. The last row uses photos; the others use exact silhouettes, which is faster. `--json` lists every person.

Examples:
  pirouette eval bodies --quick
  pirouette eval bodies --people 10 --views 8 --noise 0.5,1,2
  pirouette eval bodies --json > bodies.json";

pub const EVAL_TAPES_HELP: &str = "\
Reports per measure: bias, spread, mean and 90th percentile of the errors, repeatability, and calibration of the
standard deviations, next to the limits of standards and results of other methods.

Examples:
  pirouette eval tapes --quick
  pirouette eval tapes -o docs
  pirouette eval tapes --people 20 --views 8,9,12 --json > tapes.json";

pub const EVAL_FAULTS_HELP: &str = "\
About 40 kinds of mistake in three strengths: keypoints of other photos, a moved camera, wrong statements, bad masks,
people who are cut off. Wrong: not refused, and a measure is off by more than three standard deviations and 10 mm.
`--json` lists every capture. A person takes about five minutes.

Examples:
  pirouette eval faults --people 1
  pirouette eval faults --only keypoints,masks
  pirouette eval faults -o docs --json > faults.json";

pub const EVAL_ABLATION_HELP: &str = "\
Examples:
  pirouette eval ablation
  pirouette eval ablation --people 2 --json";

pub const EVAL_ANGLES_HELP: &str = "\
Errors of the angles by the keypoints of each photo, by the skeleton of all photos, and by the body; and errors of the body
with unknown and with known angles. `--json` lists every person.

Examples:
  pirouette eval angles --people 2
  pirouette eval angles -o docs";

pub const EVAL_CLOTHES_HELP: &str = "\
Outfits: as tight as skin, the same with a bun, long hair, an afro, a hat, or shoes; normal and loose clothes; a skirt. Reports
the overlap of silhouettes, refused scans, and errors of measures against the naked body. `--json` lists every scan.

Examples:
  pirouette eval clothes --people 2
  pirouette eval clothes --json > clothes.json";

pub const EVAL_VIDEOS_HELP: &str = "\
Turns at an even and at a changing speed, clockwise, with a pause, and by one turn and a half, in 8, 16 and 36 views.
Compares what finds the turn, and bodies with the true angles. Requires the program ffmpeg and the pose detector; a video
takes about three minutes.

Examples:
  pirouette eval videos --people 1
  pirouette eval videos -o docs";

pub const EVAL_SCANS_HELP: &str = "\
Ground truth: truth/<photo>_mask.png, and optionally truth/<photo>_canonical.png (the person standing still in the
reference pose), truth/body.ply and truth/truth.json with measurements_mm. `pirouette demo` writes all of these.

Examples:
  pirouette eval scans pirouette-demo/scan
  pirouette eval scans scans/*                     scan all folders to eval-out, then score
  pirouette eval scans scans/* -o results --keep   score the existing results/<name>";

pub const EVAL_PHOTOS_HELP: &str = "\
Ground truth: truth/<photo>_mask.png. Each photo is segmented separately. A photo without a result scores 0.

Examples:
  pirouette eval photos street
  pirouette eval photos photos/* --json";
