//! The command line: subcommands, switches and their help.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use pirouette::io::export::ExportFormat;
use pirouette::io::mesh::MeshFormat;

/// From photos of a turning person to silhouettes, a 3D body and tape measurements
#[derive(Debug, Parser)]
#[command(
    name = "pirouette",
    version,
    arg_required_else_help = true,
    propagate_version = true,
    after_help = "\
Examples:
  pirouette demo                      renders a turning person and scans it: needs no input
  pirouette scan photos/anna -o anna  silhouettes, body and measurements of a scan folder
  pirouette scan --help               what a scan folder looks like

Exit codes: 0 done, 1 failed, 2 wrong usage."
)]
pub struct Cli {
    /// The job
    #[command(subcommand)]
    pub command: Command,

    /// Print one machine-readable line on standard output instead of text
    #[arg(long, global = true, display_order = 100)]
    pub json: bool,

    /// Print nothing but errors
    #[arg(long, short, global = true, display_order = 101)]
    pub quiet: bool,

    /// Threads to use [default: one per processor]
    #[arg(long, short, global = true, display_order = 102, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
}

/// What to do
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Scan a folder of photos: segment, normalize, carve, measure
    #[command(after_help = SCAN_HELP)]
    Scan(ScanArgs),
    /// Render a turning person whose measures are known, scan it, and compare
    #[command(after_help = DEMO_HELP)]
    Demo(DemoArgs),
    /// Find the silhouettes only; works with a single photo too
    #[command(after_help = SEGMENT_HELP)]
    Segment(ScanArgs),
    /// Find the silhouettes and bring them to the reference pose
    #[command(after_help = NORMALIZE_HELP)]
    Normalize(ScanArgs),
    /// Find silhouettes, bring them to the reference pose and carve the body
    #[command(after_help = RECONSTRUCT_HELP)]
    Reconstruct(ScanArgs),
    /// Do what `scan` does: silhouettes, body, measurements
    #[command(after_help = MEASURE_HELP)]
    Measure(ScanArgs),
    /// Tell sizes of garments from a result folder
    #[command(after_help = SIZE_HELP)]
    Size(SizeArgs),
    /// Write the reference figure: a PNG silhouette or a mesh
    #[command(after_help = AVATAR_HELP)]
    Avatar(AvatarArgs),
    /// Deform a planar mesh as rigidly as possible
    #[command(after_help = ARAP_HELP)]
    Arap(ArapArgs),
    /// Tell how accurate pirouette is: studies on rendered people, scores against truth
    #[command(after_help = EVAL_HELP)]
    Eval(EvalArgs),
    /// Print completions for a shell
    #[command(after_help = COMPLETIONS_HELP)]
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
}

/// Arguments of the main job and its stages
#[derive(Debug, Args)]
pub struct ScanArgs {
    /// Folder of photos with keypoint files, perhaps a scan.json
    #[arg(value_name = "SCAN")]
    pub scan: PathBuf,

    /// Result folder; an existing one is replaced file by file, never emptied
    #[arg(short, long, value_name = "OUT", default_value = "out")]
    pub out: PathBuf,

    #[command(flatten)]
    pub method: MethodArgs,

    /// Formats of the body, where one is carved
    #[arg(
        long,
        value_name = "FORMATS",
        value_delimiter = ',',
        default_value = "ply"
    )]
    pub format: Vec<Format>,

    /// Write report.html too: all results on one page that needs no other file
    #[arg(long)]
    pub report: bool,

    /// Write the measurements for other programs, too
    #[arg(long, value_name = "NAMES", value_enum, value_delimiter = ',')]
    pub export: Vec<Export>,

    /// Where the scale comes from when scan.json tells neither `stature_mm` nor `mm_per_px`: `card` looks for an ID-1 card
    /// (85.60 x 53.98 mm, as bank cards) beside the person
    #[arg(long, value_name = "SOURCE", value_enum)]
    pub scale: Option<ScaleSource>,

    /// Size charts to use instead of the built-in ones; see `size --help`
    #[arg(long, value_name = "FILE.toml")]
    pub chart: Option<PathBuf>,
}

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

/// How the job is done
#[derive(Debug, Args)]
pub struct MethodArgs {
    /// `fit` explains all views by one body; `three-step` is the published method, view by view
    #[arg(long, value_enum, default_value_t = Method::Fit)]
    pub method: Method,

    /// Skinned glTF or VRM figure to use as the reference instead of the built-in one
    #[arg(long, value_name = "FILE.glb|.vrm")]
    pub avatar: Option<PathBuf>,

    /// Fit each view's silhouette to that of the reference by a rigid motion [default with three-step]
    #[arg(long, overrides_with = "no_register")]
    pub register: bool,

    /// Leave the registration out [default with fit]
    #[arg(long)]
    pub no_register: bool,

    /// Refine arms and legs against the reference [default with three-step]
    #[arg(long, overrides_with = "no_refine")]
    pub refine: bool,

    /// Leave the refinement out [default with fit]
    #[arg(long)]
    pub no_refine: bool,

    /// Carve the visual hull, too, and write it beside the fitted body, in the same formats
    #[arg(long)]
    pub hull: bool,
}

/// Arguments of `demo`
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Result folder; the rendered photos go to its `scan` folder
    #[arg(short, long, value_name = "OUT", default_value = "pirouette-demo")]
    pub out: PathBuf,

    /// Other seeds give other clothes, rooms, sway and noise
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub seed: u64,

    /// Photos over one turn
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub views: usize,

    /// The rendered person
    #[arg(long, value_enum, default_value_t = Sex::Female)]
    pub sex: Sex,

    /// Height, in mm
    #[arg(long, value_name = "MM", default_value_t = 1660.0)]
    pub stature: f64,

    /// Body mass, in kg
    #[arg(long, value_name = "KG", default_value_t = 72.0)]
    pub mass: f64,

    /// How the person stands
    #[arg(long, value_enum, default_value_t = Pose::A)]
    pub pose: Pose,

    /// Write report.html too: all results on one page that needs no other file
    #[arg(long)]
    pub report: bool,

    #[command(flatten)]
    pub method: MethodArgs,
}

/// Arguments of `avatar`
#[derive(Debug, Args)]
pub struct AvatarArgs {
    /// The reference pose
    #[arg(long, value_enum, default_value_t = Pose::A)]
    pub pose: Pose,

    /// How far the figure has turned to its own left, in degrees; for .png
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub angle: f64,

    /// Whose proportions; half way between the two when not given
    #[arg(long, value_enum)]
    pub sex: Option<Sex>,

    /// Height, in mm [default: average, or that of the given figure]
    #[arg(long, value_name = "MM")]
    pub stature: Option<f64>,

    /// Body mass, in kg [default: usual for the height]
    #[arg(long, value_name = "KG")]
    pub mass: Option<f64>,

    /// Skinned glTF or VRM figure to use instead of the built-in one
    #[arg(long, value_name = "FILE.glb|.vrm", conflicts_with_all = ["sex", "mass"])]
    pub avatar: Option<PathBuf>,

    /// Draw a shaded picture instead of the silhouette; for .png
    #[arg(long)]
    pub shaded: bool,

    /// Output; the ending says what: .png a picture, .glb .ply .obj .stl .off a mesh
    #[arg(short, long, value_name = "FILE", default_value = "avatar.png")]
    pub out: PathBuf,
}

/// Arguments of `arap`
#[derive(Debug, Args)]
pub struct ArapArgs {
    /// Planar triangle mesh; z is ignored
    #[arg(long, value_name = "IN.off")]
    pub mesh: PathBuf,

    /// Points of the mesh to move: rows of x,y, a header line is fine
    #[arg(long, value_name = "SRC.csv")]
    pub source: PathBuf,

    /// Where they go, row by row
    #[arg(long, value_name = "DST.csv")]
    pub target: PathBuf,

    /// The deformed mesh
    #[arg(short, long, value_name = "OUT.off")]
    pub out: PathBuf,
}

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
    /// People, both from photos and by exact silhouettes; 12 of them at other numbers of views [default: 60, with --quick 4 and 2]
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

    /// A look of a minute instead of the whole study of half an hour
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

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Method {
    Fit,
    ThreeStep,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Pose {
    A,
    T,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Sex {
    Female,
    Male,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ScaleSource {
    Card,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Export {
    /// measurements.flat.json: value and deviation per measure
    Json,
    /// measurements.csv
    Csv,
    /// measurements.schema-org.json
    SchemaOrg,
    /// measurements.freesewing.yaml
    Freesewing,
    /// measurements.vit, for Seamly2D and Valentina
    #[value(alias = "valentina")]
    Seamly2d,
}

impl Export {
    /// The library's format
    pub fn of_file(self) -> ExportFormat {
        match self {
            Export::Json => ExportFormat::Json,
            Export::Csv => ExportFormat::Csv,
            Export::SchemaOrg => ExportFormat::SchemaOrg,
            Export::Freesewing => ExportFormat::FreeSewing,
            Export::Seamly2d => ExportFormat::Seamly2d,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Format {
    Ply,
    Glb,
    Obj,
    Stl,
    Off,
}

impl Format {
    /// The library's format
    pub fn of_mesh(self) -> MeshFormat {
        match self {
            Format::Ply => MeshFormat::Ply,
            Format::Glb => MeshFormat::Glb,
            Format::Obj => MeshFormat::Obj,
            Format::Stl => MeshFormat::Stl,
            Format::Off => MeshFormat::Off,
        }
    }
}

const SCAN_HELP: &str = "\
A scan folder holds photos of a person who turns to the left in even steps before a camera that does not
move, and beside each photo its keypoints (OpenPose JSON, BODY_25):
  000.jpg 000_keypoints.json 001.jpg 001_keypoints.json ...
An optional scan.json tells more, most of all the person's height; every key but `image` may be left out,
and without `views` the photos are taken in the order of their names:
  { \"pose\": \"a\", \"subject\": { \"stature_mm\": 1748, \"sex\": \"female\", \"mass_kg\": 64, \"age_years\": 35 },
    \"camera\": { \"vertical_fov_deg\": 50.1, \"height_mm\": 890, \"distance_mm\": 2400, \"pitch_deg\": 0,
                \"mm_per_px\": 2.1 },
    \"views\": [ { \"image\": \"000.jpg\", \"keypoints\": \"000_keypoints.json\", \"angle_deg\": 0,
                 \"mask\": \"000_mask.png\" } ] }

Without the height, the scale may come from the size of a pixel at the turning axis (`mm_per_px`) or from a bank card in a
photo (`--scale card`); without any, lengths are in units of the height. With sex and mass, statistics of a survey support
the measures: details tell what came from pixels and what from them.

Examples:
  pirouette scan photos/anna
  pirouette scan photos/anna --scale card --export csv,seamly2d
  pirouette scan photos/anna -o anna --format ply,glb --report
  pirouette scan photos/anna --method three-step --no-refine
  pirouette scan photos/anna --avatar me.vrm --json | jq .measurements_mm";

const DEMO_HELP: &str = "\
Writes the photos, keypoints and the truth to OUT/scan and the results beside them.

Examples:
  pirouette demo
  pirouette demo --sex male --stature 1810 --mass 95 --seed 7 -o big
  pirouette demo --pose t --views 12 --method three-step";

const SEGMENT_HELP: &str = "\
Writes result.json, contact.jpg and, per view, mask.png, overlay.jpg and view.json.

Examples:
  pirouette segment photos/anna -o anna
  pirouette segment one_photo -o out       a folder with one photo and its keypoints";

const NORMALIZE_HELP: &str = "\
Does what `segment` does, and writes normalized.png per view and, with the method `fit`, residuals.jpg.

Examples:
  pirouette normalize photos/anna -o anna
  pirouette normalize photos/anna --method three-step --no-register --no-refine";

const RECONSTRUCT_HELP: &str = "\
Does what `normalize` does, and writes the body.

Examples:
  pirouette reconstruct photos/anna -o anna --format obj,stl";

const MEASURE_HELP: &str = "\
Does what `reconstruct` does, and writes measurements.json.

Examples:
  pirouette measure photos/anna -o anna
  pirouette measure photos/anna --json --quiet";

const SIZE_HELP: &str = "\
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

const AVATAR_HELP: &str = "\
Examples:
  pirouette avatar -o silhouette.png
  pirouette avatar --sex female --stature 1650 --mass 62 -o woman.glb
  pirouette avatar --pose t --angle 45 --shaded -o t45.png
  pirouette avatar --avatar me.vrm --pose a -o me.ply";

const ARAP_HELP: &str = "\
Each source point takes the nearest vertex along to its target; the rest follows as rigidly as possible.

Examples:
  pirouette arap --mesh square.off --source from.csv --target to.csv -o deformed.off";

const EVAL_HELP: &str = "\
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

const EVAL_BODIES_HELP: &str = "\
Random women and men of body mass indices from 17 to 38, whose surfaces no mannequin has, sway and turn. Surface:
mean distance between found and true body, both ways, after a shift and a turn about the vertical. The last
row is of photos; the others are given exact silhouettes, which is faster. `--json` tells every person.

Examples:
  pirouette eval bodies --quick
  pirouette eval bodies --people 10 --views 8 --noise 0.5,1,2
  pirouette eval bodies --json > bodies.json";

const EVAL_TAPES_HELP: &str = "\
Bias, spread, mean and 90th percentile of the errors, repeatability, and whether the deviations told with the values are
honest, per measure; beside them limits and figures of others.

Examples:
  pirouette eval tapes --quick
  pirouette eval tapes -o docs
  pirouette eval tapes --people 20 --views 8,9,12 --json > tapes.json";

const EVAL_ABLATION_HELP: &str = "\
Examples:
  pirouette eval ablation
  pirouette eval ablation --people 2 --json";

const EVAL_SCANS_HELP: &str = "\
Truth: truth/<photo>_mask.png, and perhaps truth/<photo>_canonical.png (the person standing still in the reference
pose), truth/body.ply and truth/truth.json with measurements_mm. `pirouette demo` writes all of it.

Examples:
  pirouette eval scans pirouette-demo/scan
  pirouette eval scans scans/*                     scans every folder to eval-out, then scores
  pirouette eval scans scans/* -o results --keep   scores what results/<name> holds already";

const EVAL_PHOTOS_HELP: &str = "\
Truth: truth/<photo>_mask.png. Every photo is segmented for itself. A photo without a result counts as 0.

Examples:
  pirouette eval photos street
  pirouette eval photos photos/* --json";

const COMPLETIONS_HELP: &str = "\
Examples:
  pirouette completions bash > ~/.local/share/bash-completion/completions/pirouette
  pirouette completions zsh > ~/.zfunc/_pirouette
  pirouette completions fish > ~/.config/fish/completions/pirouette.fish";

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn the_last_of_two_opposite_switches_counts() {
        let parse = |args: &[&str]| {
            let all = ["pirouette", "scan", "x"].iter().chain(args);
            match Cli::try_parse_from(all).unwrap().command {
                Command::Scan(args) => args.method,
                _ => unreachable!("scan was asked for"),
            }
        };
        assert!(parse(&["--no-register", "--register"]).register);
        assert!(!parse(&["--no-register", "--register"]).no_register);
    }
}
