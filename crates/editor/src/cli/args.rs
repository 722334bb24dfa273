//! What can be typed: subcommands, options, defaults, and the range of every number.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand, ValueEnum};
use clerestory_nystrom::rivals::{Method, UnknownMethod};
use clerestory_relight::Tone;
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::patches::MOST_PATCHES;
use clerestory_transport::sensors::{NodeGrid, SensorGrid, WorkPlane};
use clerestory_transport::skips::Skips;
use clerestory_transport::sky::{DOME_DIVISIONS, SkyForm, SkySetting};

use super::gltf::ExportGltfArgs;
use super::looks::LookChoice;
use super::picture::{CutArgs, DepthArgs};
use super::sequence::FramesArgs;
use super::viewpoint::{Viewpoint, parse_shift, parse_view};

/// Most pixels of a picture, 8192 × 8192.
const MAX_PIXELS: u64 = 1 << 26;

/// Relights a scene as fast as you can turn a knob: bakes its light transport once, then multiplies.
#[derive(Debug, Parser)]
#[command(name = "clerestory", version, args_conflicts_with_subcommands = true, after_help = EDITOR_EXAMPLE)]
pub struct Arguments {
    /// What to do; without it the editor opens.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// What the editor opens: a scene (.gltf, .glb), a .transport, or a folder with a picture for each light; the built-in
    /// gallery if left out.
    pub scene: Option<PathBuf>,
    /// Print figures as one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

const EDITOR_EXAMPLE: &str = "Example: clerestory room.glb\n\
    Without a display the scene is baked, relit under three looks, and written to frames/ in the current folder.";
const BAKE_EXAMPLE: &str = "Example: clerestory bake room.glb -o room.transport --size 640x480 --panel Ceiling=16\n         \
    or: clerestory bake room.glb -o room.transport --ies Downlight=maker/downlight.ies\n         \
    or: clerestory bake room.glb -o room.transport --irradiance --sensors Desk=16x8 --work-plane 0.75\n         \
    or: clerestory bake room.glb --estimate\n         \
    or: clerestory bake --images stage/ -o face.transport --tolerance 45";
const RELIGHT_EXAMPLE: &str = "Example: clerestory relight room.transport --look evening.look -o evening.exr --layers groups\n         \
    or: clerestory relight room.transport -o lux.exr --layers irradiance --bits 16 --compression piz\n         \
    or: clerestory relight room.transport --contact-sheet day.look evening.look -o looks.png --width 640\n         \
    or: clerestory relight room.transport --look lamps.look --scene room.glb -o lamps.exr\n         \
    or: clerestory relight room.transport --look shots.look --frames 0..48 --fps 24 -o out/frame_####.png";
const SENSORS_EXAMPLE: &str = "Example: clerestory sensors room.transport --look evening.look -o evening.csv";
const RENDER_EXAMPLE: &str = "Example: clerestory render room.glb --look evening.look -o evening.png --spp 128\n         \
    or: clerestory render room.glb --ies Downlight=maker/downlight.ies -o measured.png";
const TRACE_EXAMPLE: &str = "Example: clerestory trace room.glb --look evening.look -o reference.exr --spp 1024\n         \
    or: clerestory trace room.glb --ies Downlight=maker/downlight.ldt -o measured.exr";
const SCHEDULE_EXAMPLE: &str = "Example: clerestory schedule room.glb --look evening.look --efficacy 110 -o lamps.csv";
const SOLVE_EXAMPLE: &str = "Example: clerestory solve room.transport --wishes table.json -o table.look\n         \
    or: clerestory solve room.transport --match photo.png --colors 0.5 -o photo.look";
const COMPARE_EXAMPLE: &str = "Example: clerestory compare evening.exr reference.exr --json";
const EXPORT_GLTF_EXAMPLE: &str = "Example: clerestory export-gltf room.glb --look evening.look -o evening.glb";
const CACHE_EXAMPLE: &str = "Example: clerestory cache --clear";
const INFO_EXAMPLE: &str = "Example: clerestory info room.transport --json";

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Compute the light transport of a scene, or compress pictures taken under one light each, and write it to a file.
    ///
    /// A bake that was stopped is taken up where it stood by the same command.
    #[command(after_help = BAKE_EXAMPLE)]
    Bake(BakeArgs),
    /// Light a baked scene and write the picture.
    #[command(after_help = RELIGHT_EXAMPLE)]
    Relight(RelightArgs),
    /// Bake and relight in one go, without a transport file.
    #[command(after_help = RENDER_EXAMPLE)]
    Render(RenderArgs),
    /// Path trace a picture without a matrix: the reference.
    #[command(after_help = TRACE_EXAMPLE)]
    Trace(TraceArgs),
    /// Say how many lux arrive at the sensors of a baked scene: average, minimum, maximum, uniformity.
    #[command(after_help = SENSORS_EXAMPLE)]
    Sensors(SensorsArgs),
    /// Write a scene with its lights as a look sets them, so that it looks the same wherever it is opened.
    #[command(after_help = EXPORT_GLTF_EXAMPLE)]
    ExportGltf(ExportGltfArgs),
    /// Write a table of all lamps: lumen, watt, place, aim, color, and W/m² of floor.
    #[command(after_help = SCHEDULE_EXAMPLE)]
    Schedule(ScheduleArgs),
    /// Find the lights that come closest to wishes (lux, cd/m², a picture to match) and write them as a look.
    #[command(after_help = SOLVE_EXAMPLE)]
    Solve(SolveArgs),
    /// Hold picture A against the reference B.
    #[command(after_help = COMPARE_EXAMPLE)]
    Compare(CompareArgs),
    /// Say what is in a scene, a transport file, a look, or a folder of pictures.
    #[command(after_help = INFO_EXAMPLE)]
    Info(InfoArgs),
    /// Say how many finished bakes the editor keeps for the next time, or remove them.
    #[command(after_help = CACHE_EXAMPLE)]
    Cache(CacheArgs),
}

/// Options that every subcommand has.
#[derive(Clone, Copy, Debug, Args)]
pub struct OutputArgs {
    /// Print figures as one JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Which picture of a scene, and how well.
#[derive(Clone, Debug, Args)]
pub struct ViewArgs {
    /// Camera by name, or by number counted from 0 [default: the first].
    #[arg(long, value_name = "NAME|N")]
    pub camera: Option<String>,
    /// Look from anywhere instead: meters, then degrees; yaw 0 looks along -Z, 90 along +X [default FOV: 50, from top to bottom].
    #[arg(long = "view", value_name = "X,Y,Z,YAW,PITCH[,FOV[,ROLL]]", value_parser = parse_view, allow_hyphen_values = true,
        conflicts_with = "camera")]
    pub viewpoint: Option<Viewpoint>,
    /// Shift of the lens to the right and up, in widths and heights of the picture: a level camera that looks up by it keeps
    /// vertical edges vertical.
    #[arg(long, value_name = "X,Y", value_parser = parse_shift, allow_hyphen_values = true)]
    pub shift: Option<[f32; 2]>,
    /// Size in pixels; the camera's vertical angle stays [default: 960 wide at the camera's aspect].
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<Film>,
    /// Light paths per pixel.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    pub spp: u32,
    /// Most bounces; 0 is direct light only [default: unlimited, with Russian roulette].
    #[arg(long, value_name = "B", value_parser = clap::value_parser!(u32).range(0..=65_536))]
    pub bounces: Option<u32>,
    /// Make a planar emissive node, by its key, a panel of M × M texels, M from 4 to 64; may be repeated.
    #[arg(long = "panel", value_name = "NODE=M", value_parser = parse_panel)]
    pub panels: Vec<PanelRequest>,
    /// Give a point or spot lamp the measured distribution of an .ies or .ldt file; may be repeated.
    #[arg(long, value_name = "KEY=FILE", value_parser = parse_ies)]
    pub ies: Vec<IesRequest>,
    /// Take the numbers of lamps as watts per steradian (per m² if directional), not as candela and lux: 1 becomes 683.
    #[arg(long)]
    pub unitless: bool,
    /// Sky: an equirectangular .hdr or .exr, `uniform`, or `sun:AZIMUTH,ELEVATION` in degrees.
    #[arg(long, value_name = "FILE|uniform|sun:AZ,EL", value_parser = crate::look::sky::typed, allow_hyphen_values = true)]
    pub sky: Option<SkySetting>,
    /// Leave out no work that a scene does not need, or not the work of these names: slower, and the same picture.
    #[arg(long, value_name = "NAMES", num_args = 0..=1, require_equals = true, default_missing_value = "all",
        value_parser = Skips::all_but)]
    pub no_skip: Option<Skips>,
    /// Seed of all random numbers.
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub seed: u64,
    /// Threads to use [default: one per core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

impl ViewArgs {
    /// The work that is left out.
    pub fn skips(&self) -> Skips {
        self.no_skip.unwrap_or_default()
    }
}

/// A lamp that takes a measured distribution.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IesRequest {
    /// Key of the lamp.
    pub key: String,
    /// File of its maker.
    pub file: PathBuf,
}

/// Options of a bake, wherever it goes.
#[derive(Clone, Debug, Args)]
pub struct BakeOptions {
    /// Picture and quality.
    #[command(flatten)]
    pub view: ViewArgs,
    /// Patches of the sky above the horizon.
    #[arg(long, value_name = "145|577|2305", default_value = "145", value_parser = parse_patches)]
    pub sky_patches: SkyForm,
    /// Signal to error in decibels that the bake aims at.
    #[arg(long, value_name = "DB", default_value_t = 40.0, value_parser = parse_tolerance)]
    pub tolerance: f32,
    /// Seconds that the bake may take, scene loading not counted: it goes over the picture with four times the samples each
    /// time, from the middle outwards, and ends with what it has; --spp and --tolerance still end it sooner. A preview is
    /// always made whole.
    #[arg(long, value_name = "N", value_parser = parse_seconds, conflicts_with = "patches")]
    pub seconds: Option<Duration>,
    /// Share the light between surfaces among neighboring pixels: smoother at the same samples, but smeared over a few
    /// pixels; the error says by how much, as measured on pixels that are traced as well.
    #[arg(long, conflicts_with = "exact")]
    pub fast: bool,
    /// Follow the light between surfaces from every sample, without bias (the default).
    #[arg(long)]
    pub exact: bool,
    /// Also bake how free lamps light the scene by way of its surfaces, told apart into about N patches (4096 will do, at most
    /// 16384): lamps of a look can then be moved and added after the bake. 0 is none.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=i64::from(MOST_PATCHES)))]
    pub patches: u32,
    /// What makes factors of the samples: `projected` is our own, the others are there to be compared with, such as `svd`,
    /// `row-id`, `aca-full` or `alg4:qr`; a name that does not exist lists them all.
    #[arg(long, value_name = "NAME", default_value_t, value_parser = parse_method)]
    pub method: Method,
    /// Start over, even if an earlier bake of the same name was stopped half way or could be taken over.
    #[arg(long)]
    pub fresh: bool,
}

/// Options that mean nothing to pictures that were taken: nothing is traced.
const OF_SCENES: [&str; 23] = [
    "scene",
    "camera",
    "viewpoint",
    "shift",
    "size",
    "spp",
    "seconds",
    "bounces",
    "panels",
    "ies",
    "unitless",
    "sky",
    "no_skip",
    "sky_patches",
    "fast",
    "exact",
    "patches",
    "irradiance",
    "sensors",
    "work_planes",
    "estimate",
    "memory",
    "reuse",
];

/// `clerestory bake`.
#[derive(Debug, Args)]
pub struct BakeArgs {
    /// Scene, .gltf or .glb.
    #[arg(required_unless_present = "images")]
    pub scene: Option<PathBuf>,
    /// Bake pictures instead of a scene: a folder with one .exr, .hdr, .png or .jpg of the same view for each light, whose
    /// key is the file's name. Takes 1 GiB of memory for pixels, however many there are.
    #[arg(long, value_name = "DIR", conflicts_with_all = OF_SCENES)]
    pub images: Option<PathBuf>,
    /// Transport file to write.
    #[arg(short, long, value_name = "FILE.transport", required_unless_present = "estimate")]
    pub output: Option<PathBuf>,
    /// Do not bake: try some blocks, and tell about how long it will take, how much memory, and how large the file will be.
    #[arg(long, conflicts_with_all = ["output", "seconds"])]
    pub estimate: bool,
    /// Earlier bake whose columns are taken over, where surfaces, view and settings are the same; only lights that are new or
    /// have moved are traced [default: the output file, if it is there].
    #[arg(long, value_name = "FILE.transport", conflicts_with_all = ["estimate", "fresh"])]
    pub reuse: Option<PathBuf>,
    /// Take no more memory than this, such as 8GB: fewer threads bake if need be. A bake that takes more on a single thread is refused
    /// before it starts.
    #[arg(long, value_name = "SIZE", value_parser = super::estimate::parse_bytes)]
    pub memory: Option<u64>,
    /// How to bake.
    #[command(flatten)]
    pub options: BakeOptions,
    /// What to measure beside the picture.
    #[command(flatten)]
    pub irradiance: IrradianceArgs,
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}

/// Light that arrives, beside the light that is seen.
#[derive(Clone, Debug, Default, Args)]
pub struct IrradianceArgs {
    /// Also bake the light that arrives at the surfaces of the picture, and at the sensors that the file marks.
    #[arg(long)]
    pub irradiance: bool,
    /// Also bake the light that arrives at W × H points on the front of a planar quad; may be repeated.
    #[arg(long, value_name = "NODE=WxH", value_parser = parse_sensors)]
    pub sensors: Vec<NodeGrid>,
    /// Also bake the light that arrives at a level plane, meters above the floor; points every SPACING meters, else as
    /// EN 12464-1 spaces them; may be repeated.
    #[arg(long = "work-plane", value_name = "HEIGHT[:SPACING]", value_parser = parse_work_plane)]
    pub work_planes: Vec<WorkPlane>,
}

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
    /// Luminous efficacy of the lamps: their watts are lumen over this.
    #[arg(long, value_name = "LM/W", default_value_t = 100.0, value_parser = parse_positive)]
    pub efficacy: f64,
    /// Floor area in m² [default: that of the scene's floor; none for a transport file].
    #[arg(long = "floor-area", value_name = "M2", value_parser = parse_positive)]
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
    /// Wishes, as docs/cli.md describes them.
    #[arg(long, value_name = "FILE.json", required_unless_present = "picture")]
    pub wishes: Option<PathBuf>,
    /// Picture to match, of any size: linear .exr or .hdr in nit, or .png or .jpg, whose exposure is found.
    #[arg(long = "match", value_name = "PICTURE")]
    pub picture: Option<PathBuf>,
    /// Exposure of the picture to match: nit times 2^EV are its numbers.
    #[arg(long, value_name = "EV", requires = "picture", allow_negative_numbers = true)]
    pub exposure: Option<f64>,
    /// Tone curve that a .png or .jpg to match was made with: agx, aces, neutral, reinhard or linear [default: what a PNG of this
    /// program says, else linear]
    #[arg(long, value_name = "CURVE", requires = "picture", value_parser = parse_tone)]
    pub tone: Option<Tone>,
    /// Scene that was baked: for surfaces by name, means over areas of surface, and lamps of the look.
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Look to start from [default: as the scene says].
    #[arg(long, value_name = "FILE.look")]
    pub look: Option<PathBuf>,
    /// Light that may change, by its key; may be repeated [default: all that are not muted].
    #[arg(long = "light", value_name = "KEY")]
    pub lights: Vec<String>,
    /// Least and largest intensity, times the file [default: 0:100].
    #[arg(long, value_name = "MIN:MAX", value_parser = parse_factor)]
    pub factor: Option<[f64; 2]>,
    /// Let colors change, too, up to a saturation of 0 (white) to 1 (any color).
    #[arg(long, value_name = "SATURATION")]
    pub colors: Option<f64>,
    /// How much the rest of the picture counts, beside 1 for a wish [default: 0.001].
    #[arg(long, value_name = "WEIGHT")]
    pub keep: Option<f64>,
    /// How much a light that stays as it is counts [default: 0.001].
    #[arg(long, value_name = "STRENGTH")]
    pub pull: Option<f64>,
    /// Look to write.
    #[arg(short, long, value_name = "OUT.look")]
    pub output: PathBuf,
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}

/// How to light and what to write.
#[derive(Clone, Debug, Args)]
pub struct RelightOptions {
    /// Look to light it with [default: as the scene says].
    #[arg(long, value_name = "FILE.look")]
    pub look: Option<PathBuf>,
    /// What of it.
    #[command(flatten)]
    pub choice: LookChoice,
    /// Picture to write: linear .exr or display-encoded .png.
    #[arg(short, long, value_name = "OUT.exr|OUT.png")]
    pub output: PathBuf,
    /// What multiplies; `auto` is a real GPU if there is one, `gpu` takes any adapter or fails.
    #[arg(long, value_enum, default_value_t = Device::Auto)]
    pub device: Device,
    /// Layers beside the picture itself (EXR only); `lights` adds KEY.R, KEY.G, KEY.B for every light, `groups` such for
    /// every kind of light, `irradiance` adds irradiance.R, irradiance.G, irradiance.B: the light that arrives, in lux per
    /// channel. Several are set apart by commas.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "none")]
    pub layers: Vec<Layers>,
    /// Numbers of the file.
    #[command(flatten)]
    pub depth: DepthArgs,
    /// How much of the picture.
    #[command(flatten)]
    pub cut: CutArgs,
}

/// `clerestory relight`.
#[derive(Debug, Args)]
pub struct RelightArgs {
    /// Transport file of an earlier bake.
    pub transport: PathBuf,
    /// Scene that was baked: lamps of the look, which are free to be anywhere, light its surfaces.
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Relight under each of these looks instead, and put the pictures on one sheet (PNG) with their names.
    #[arg(long, value_name = "FILE.look", num_args = 1.., conflicts_with = "look")]
    pub contact_sheet: Vec<PathBuf>,
    /// How to light.
    #[command(flatten)]
    pub options: RelightOptions,
    /// Which frames of a timeline.
    #[command(flatten)]
    pub frames: FramesArgs,
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

/// `clerestory render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Scene, .gltf or .glb.
    pub scene: PathBuf,
    /// How to bake; nothing is kept, so every render is a fresh one.
    #[command(flatten)]
    pub bake: BakeOptions,
    /// How to light.
    #[command(flatten)]
    pub relight: RelightOptions,
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}

/// `clerestory trace`.
#[derive(Debug, Args)]
pub struct TraceArgs {
    /// Scene, .gltf or .glb.
    pub scene: PathBuf,
    /// Look to light it with [default: as the scene says].
    #[arg(long, value_name = "FILE.look")]
    pub look: Option<PathBuf>,
    /// What of it.
    #[command(flatten)]
    pub choice: LookChoice,
    /// Picture to write: linear .exr or display-encoded .png.
    #[arg(short, long, value_name = "OUT.exr|OUT.png")]
    pub output: PathBuf,
    /// Picture and quality.
    #[command(flatten)]
    pub view: ViewArgs,
    /// Numbers of the file.
    #[command(flatten)]
    pub depth: DepthArgs,
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
    /// How to answer.
    #[command(flatten)]
    pub answer: OutputArgs,
}

/// What multiplies factors and coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Device {
    /// A hardware GPU if there is one, else the CPU.
    Auto,
    /// Any graphics adapter, software ones too; fails without.
    Gpu,
    /// The processor.
    Cpu,
}

/// Which layers an EXR gets beside R, G, B.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Layers {
    /// None.
    None,
    /// One per light.
    Lights,
    /// One per kind of light: lamps, luminous surfaces, panels, sky, unlit surfaces, free lamps.
    Groups,
    /// The light that arrives at what is seen.
    Irradiance,
}

fn parse_size(text: &str) -> Result<Film, String> {
    let problem = || format!("write WIDTHxHEIGHT such as 960x540, each from 1 to {}", Film::MAX_SIDE);
    let (width, height) = text.split_once(['x', 'X', '×']).ok_or_else(problem)?;
    let side = |text: &str| text.parse::<u32>().ok().filter(|side| (1..=Film::MAX_SIDE).contains(side));
    let (width, height) = side(width).zip(side(height)).ok_or_else(problem)?;
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(format!("at most {MAX_PIXELS} pixels in all (8192x8192)"));
    }
    Ok(Film { width, height })
}

pub(super) fn parse_panel(text: &str) -> Result<PanelRequest, String> {
    // A node's name may hold '=', a number cannot.
    let (node, resolution) = text.rsplit_once('=').ok_or("write NODE=M such as Ceiling=16")?;
    let resolution: u32 = resolution.parse().map_err(|_| "M must be a whole number from 4 to 64")?;
    if node.is_empty() || !(4..=64).contains(&resolution) {
        return Err("write NODE=M with the name of a node and M from 4 to 64".into());
    }
    Ok(PanelRequest { node: node.into(), resolution })
}

fn parse_ies(text: &str) -> Result<IesRequest, String> {
    // A node's name may hold '=' as well as a path may; names do more often.
    match text.rsplit_once('=') {
        Some((key, file)) if !key.is_empty() && !file.is_empty() => {
            Ok(IesRequest { key: key.into(), file: file.into() })
        }
        _ => Err("write KEY=FILE such as Downlight=downlight.ies".into()),
    }
}

fn parse_sensors(text: &str) -> Result<NodeGrid, String> {
    let problem = || format!("write NODE=WxH such as Desk=16x8, each from 1 to {}", SensorGrid::MAX_SIDE);
    let (node, size) = text.rsplit_once('=').filter(|(node, _)| !node.is_empty()).ok_or_else(problem)?;
    let (across, down) = size.split_once(['x', 'X', '×']).ok_or_else(problem)?;
    let side = |text: &str| text.parse::<u32>().ok().filter(|side| (1..=SensorGrid::MAX_SIDE).contains(side));
    let (across, down) = side(across).zip(side(down)).ok_or_else(problem)?;
    Ok(NodeGrid { node: node.into(), size: [across, down] })
}

fn parse_work_plane(text: &str) -> Result<WorkPlane, String> {
    let problem = "write HEIGHT or HEIGHT:SPACING in meters, such as 0.75:0.5; the height from 0 to 10000";
    let (height, spacing) = text.split_once(':').map_or((text, None), |(height, spacing)| (height, Some(spacing)));
    let meters = |text: &str| text.parse::<f32>().ok().filter(|m| (0.0..=1e4).contains(m)).ok_or(problem);
    let spacing_m = spacing.map(|text| meters(text).and_then(|m| if m >= 1e-3 { Ok(m) } else { Err(problem) }));
    Ok(WorkPlane { height_m: meters(height)?, spacing_m: spacing_m.transpose()? })
}

fn parse_positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|x| (1e-3..=1e9).contains(x));
    number.ok_or_else(|| "write a number above 0".into())
}

fn parse_factor(text: &str) -> Result<[f64; 2], String> {
    let problem = || "write MIN:MAX such as 0:10".to_string();
    let (least, most) = text.split_once(':').ok_or_else(problem)?;
    let number = |text: &str| text.parse::<f64>().ok().filter(|x| (0.0..=1e6).contains(x)).ok_or_else(problem);
    Ok([number(least)?, number(most)?])
}

fn parse_patches(text: &str) -> Result<SkyForm, String> {
    let patches = |divisions: &u32| (144 * divisions * divisions + 1).to_string();
    let divisions = DOME_DIVISIONS.into_iter().find(|divisions| patches(divisions) == text);
    divisions.map(SkyForm::Patches).ok_or_else(|| "write 145, 577 or 2305".into())
}

fn parse_method(text: &str) -> Result<Method, String> {
    let method: Method = text.parse().map_err(|error: UnknownMethod| error.to_string())?;
    match method.without_factors() {
        Some(why) => Err(format!(
            "`{method}` cannot relight in compressed form: {why}; its error stands in the table of methods in docs/benchmarks.md"
        )),
        None => Ok(method),
    }
}

fn parse_seconds(text: &str) -> Result<Duration, String> {
    let secs = text.parse::<f32>().ok().filter(|secs| *secs > 0.0 && *secs <= 1e6);
    secs.map(Duration::from_secs_f32).ok_or_else(|| "give seconds above 0 and up to 1000000".into())
}

fn parse_tolerance(text: &str) -> Result<f32, String> {
    let decibels = text.parse::<f32>().ok().filter(|db| (0.0..=120.0).contains(db));
    decibels.ok_or_else(|| "write decibels from 0 to 120, such as 40".into())
}

fn parse_tone(name: &str) -> Result<Tone, String> {
    serde_json::from_value(name.into()).map_err(|_| "give agx, aces, neutral, reinhard or linear".to_owned())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn defaults_are_those_of_the_manual() {
        let arguments = Arguments::try_parse_from(["clerestory", "bake", "a.glb", "-o", "a.transport"]).unwrap();
        let Some(Command::Bake(bake)) = arguments.command else { panic!("bake was asked for") };
        let view = &bake.options.view;
        assert_eq!((view.spp, view.bounces, view.size, view.seed), (256, None, None, 0));
        assert_eq!((bake.options.tolerance, bake.options.fresh), (40.0, false));
        assert_eq!(bake.options.method, Method::Projected);
        assert_eq!((&view.sky, bake.options.sky_patches), (&None, SkyForm::Patches(1)));
        assert!(view.skips().is_all());
    }

    #[test]
    fn numbers_out_of_range_are_refused() {
        let bad = [
            ["--spp", "0"],
            ["--spp", "-3"],
            ["--seconds", "0"],
            ["--seconds", "nan"],
            ["--size", "0x4"],
            ["--size", "20000x20"],
            ["--size", "12"],
            ["--size", "16384x16384"],
            ["--tolerance", "nan"],
            ["--tolerance", "inf"],
            ["--tolerance", "-4"],
            ["--panel", "a=3"],
            ["--panel", "a=65"],
            ["--panel", "=8"],
            ["--panel", "a"],
            ["--ies", "a.ies"],
            ["--ies", "=a.ies"],
            ["--ies", "a="],
            ["--bounces", "-1"],
            ["--sensors", "desk"],
            ["--sensors", "=4x4"],
            ["--sensors", "desk=4"],
            ["--sensors", "desk=0x4"],
            ["--sensors", "desk=9999x4"],
            ["--work-plane", "low"],
            ["--work-plane", "nan"],
            ["--work-plane", "0.8:0"],
            ["--work-plane", "0.8:"],
            ["--view", "0,1,2"],
            ["--shift", "0"],
            ["--threads", "0"],
            ["--sky", ""],
            ["--method", "best"],
            ["--method", "kernel"],
            ["--method", "compressed-sensing"],
            ["--sky", "sun:10"],
            ["--sky-patches", "146"],
            ["--no-skip=color", "--json"],
        ];
        for [option, value] in bad {
            let line = ["clerestory", "bake", "a.glb", "-o", "a.transport", option, value];
            assert!(Arguments::try_parse_from(line).is_err(), "{option} {value} was accepted");
        }
    }

    #[test]
    fn pictures_take_the_place_of_a_scene_and_of_its_options() {
        let line = |rest: &str| {
            let line = format!("clerestory bake --images stage -o a.transport {rest}");
            Arguments::try_parse_from(line.split_whitespace().map(str::to_owned))
        };
        assert!(line("--seconds 10").is_err());
        assert!(line("--tolerance 45 --fresh --seed 3 --threads 2 --json").is_ok());
        for of_scenes in [
            "a.glb",
            "--spp 4",
            "--size 4x4",
            "--camera 0",
            "--view 0,1,2,0,0",
            "--shift 0,0.1",
            "--bounces 1",
            "--panel a=4",
            "--ies a=b",
            "--unitless",
            "--sky uniform",
            "--no-skip",
            "--sky-patches 145",
            "--fast",
            "--exact",
            "--irradiance",
            "--sensors a=4x4",
            "--work-plane 1",
        ] {
            assert!(line(of_scenes).is_err(), "{of_scenes} was accepted");
        }
        assert!(Arguments::try_parse_from(["clerestory", "bake", "-o", "a.transport"]).is_err());
    }

    #[test]
    fn a_panel_name_may_hold_an_equals_sign() {
        let request = parse_panel("a=b=16").unwrap();
        assert_eq!((request.node.as_str(), request.resolution), ("a=b", 16));
    }

    #[test]
    fn a_scene_alone_opens_the_editor() {
        let arguments = Arguments::try_parse_from(["clerestory", "room.glb"]).unwrap();
        assert!(arguments.command.is_none() && arguments.scene == Some("room.glb".into()));
    }
}
