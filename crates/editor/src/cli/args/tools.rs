//! Options of the commands that measure, solve, compare and tell.

use std::path::PathBuf;

use clap::Args;
use clerestory_relight::Tone;

use super::parse::{parse_factor, parse_positive, parse_schedule_by, parse_tone};
use super::{LookChoice, OutputArgs};
use crate::schedule::ScheduleBy;

/// `clerestory sensors`.
#[derive(Debug, Args)]
pub struct SensorsArgs {
    /// Transport file of an earlier bake with sensors.
    pub transport: PathBuf,
    /// Look to light it with [default: as the scene says].
    #[arg(long, value_name = "FILE.look")]
    pub look: Option<PathBuf>,
    /// Scene that was baked, so that the lamps of the look count.
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// What of it.
    #[command(flatten)]
    pub choice: LookChoice,
    /// Table to write: grid, x, y, z in meters, and lux of every point.
    #[arg(short, long, value_name = "OUT.csv")]
    pub output: Option<PathBuf>,
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}

/// `clerestory schedule`.
#[derive(Debug, Args)]
pub struct ScheduleArgs {
    /// Scene, or transport file of an earlier bake.
    pub file: PathBuf,
    /// Look that says how the lamps are set [default: as the scene says].
    #[arg(long, value_name = "FILE.look")]
    pub look: Option<PathBuf>,
    /// What has a row: every lamp, or every type of lamp with how many there are of it.
    #[arg(long, value_name = "ROW", value_parser = parse_schedule_by, default_value = "lamp")]
    pub by: ScheduleBy,
    /// Luminous efficacy of lamps whose photometric file states no watts: theirs are lumen over this [default: unknown].
    #[arg(long, value_name = "LM/W", value_parser = parse_positive, allow_negative_numbers = true)]
    pub efficacy: Option<f64>,
    /// Floor area in m² [default: that of the scene's floor; none for a transport file].
    #[arg(long = "floor-area", value_name = "M2", value_parser = parse_positive, allow_negative_numbers = true)]
    pub floor_m2: Option<f64>,
    /// Table to write.
    #[arg(short, long, value_name = "OUT.csv")]
    pub output: PathBuf,
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}

/// `clerestory solve`.
#[derive(Debug, Args)]
pub struct SolveArgs {
    /// Transport file of an earlier bake.
    pub transport: PathBuf,
    /// Wishes, as docs/cli.md describes them [default: those of the look].
    #[arg(long, value_name = "FILE.json", required_unless_present_any = ["picture", "look"])]
    pub wishes: Option<PathBuf>,
    /// Picture to match, of any size: linear .exr or .hdr in nit, or .png or .jpg, whose exposure is found.
    #[arg(long = "match", value_name = "PICTURE")]
    pub picture: Option<PathBuf>,
    /// Exposure of the picture to match: nit times 2^EV are its numbers.
    #[arg(long, value_name = "EV", requires = "picture", allow_negative_numbers = true)]
    pub exposure: Option<f64>,
    /// Tone curve that a .png or .jpg to match was made with, where it does not say so itself as those of this program do: agx, aces,
    /// neutral, reinhard or linear [default: linear].
    #[arg(long, value_name = "CURVE", requires = "picture", value_parser = parse_tone)]
    pub tone: Option<Tone>,
    /// Scene that was baked: for surfaces by name, means over areas of surface, and lamps of the look.
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Look to start from [default: as the scene says]; what is wished in it is solved where neither --wishes nor --match is given.
    #[arg(long, value_name = "FILE.look")]
    pub look: Option<PathBuf>,
    /// Light that may change, by its key; may be repeated [default: all that are not muted].
    #[arg(long = "light", value_name = "KEY")]
    pub lights: Vec<String>,
    /// Least and largest intensity, times the file [default: 0:100].
    #[arg(long, value_name = "MIN:MAX", value_parser = parse_factor)]
    pub factor: Option<[f64; 2]>,
    /// Let colors change, too, up to a saturation of 0 (white) to 1 (any color).
    #[arg(long, value_name = "SATURATION", allow_negative_numbers = true)]
    pub colors: Option<f64>,
    /// How much the rest of the picture counts, beside 1 for a wish [default: 0.001].
    #[arg(long, value_name = "WEIGHT", allow_negative_numbers = true)]
    pub keep: Option<f64>,
    /// How much a light that stays as it is counts [default: 0.001].
    #[arg(long, value_name = "STRENGTH", allow_negative_numbers = true)]
    pub pull: Option<f64>,
    /// Look to write.
    #[arg(short, long, value_name = "OUT.look")]
    pub output: PathBuf,
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}

/// `clerestory cache`.
#[derive(Debug, Args)]
pub struct CacheArgs {
    /// Remove all of them.
    #[arg(long)]
    pub clear: bool,
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}

/// `clerestory compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Picture, linear .exr.
    pub a: PathBuf,
    /// Reference, linear .exr of the same size.
    pub b: PathBuf,
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}

/// `clerestory info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// Scene, transport file, look, or folder of pictures.
    pub file: PathBuf,
    /// Variant of the materials of a scene, by its name [default: what the file shows].
    #[arg(long, value_name = "NAME")]
    pub variant: Option<String>,
    /// Also list the error of every block of a transport, in its layers.
    #[arg(long, requires = "json")]
    pub block_errors: bool,
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}
