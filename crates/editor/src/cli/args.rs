//! What can be typed: subcommands, options, defaults, and the range of every number.

mod parse;
mod tools;

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand, ValueEnum};
use clerestory_nystrom::rivals::Method;
use clerestory_transport::bake::SIDE;
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::import::Choice;
use clerestory_transport::patches::MOST_PATCHES;
use clerestory_transport::sensors::{NodeGrid, WorkPlane};
use clerestory_transport::skips::Skips;
use clerestory_transport::sky::{SkyForm, SkySetting};

use super::gltf::ExportGltfArgs;
use super::lamps::DEFAULT_SAMPLES;
use super::looks::LookChoice;
use super::picture::{CutArgs, DepthArgs};
use super::sequence::FramesArgs;
use super::viewpoint::{Viewpoint, parse_shift, parse_view};
use crate::look::Look;
use crate::look::scene::SceneChoice;
pub(super) use parse::parse_panel;
use parse::{
    parse_block, parse_ies, parse_method, parse_patches, parse_seconds, parse_sensors, parse_size, parse_sun_size,
    parse_tolerance, parse_work_plane,
};
pub use tools::{CacheArgs, CompareArgs, InfoArgs, ScheduleArgs, SensorsArgs, SolveArgs};

/// Relights a scene as fast as you can turn a knob: bakes its light transport once, then multiplies.
#[derive(Debug, Parser)]
#[command(name = "clerestory", version, args_conflicts_with_subcommands = true, after_help = EDITOR_EXAMPLE)]
pub struct Arguments {
    /// What to do; without it the editor opens.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// What the editor opens: a scene (.gltf, .glb), a .transport, a .look with the scene that it was saved for, else with the
    /// one that was open last, or a folder with a picture for each light; the built-in gallery if left out.
    pub scene: Option<PathBuf>,
    /// Without a display, print figures as one JSON object on stdout; a window prints none.
    #[arg(long)]
    pub json: bool,
}

const EDITOR_EXAMPLE: &str = "Example: clerestory room.glb\n\
    Without a display the scene is baked, relit under three looks or those of the .look, and written to frames/ in the current folder.";
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
    #[arg(long, value_name = "NAME|N", allow_negative_numbers = true)]
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
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..=1_048_576),
        allow_negative_numbers = true)]
    pub spp: u32,
    /// Most bounces; 0 is direct light only [default: unlimited, with Russian roulette].
    #[arg(long, value_name = "B", value_parser = clap::value_parser!(u32).range(0..=65_536),
        allow_negative_numbers = true)]
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
    /// Angle in degrees under which the directional lamps of the file are seen, from rim to rim: 0.53 is the sun [default: 0,
    /// shadows without penumbra].
    #[arg(long, value_name = "DEG", value_parser = parse_sun_size, allow_negative_numbers = true)]
    pub sun_size: Option<f32>,
    /// Variant of the materials of the file, by its name (`info` lists them) [default: what the file shows].
    #[arg(long, value_name = "NAME")]
    pub variant: Option<String>,
    /// Follow light on rough metal and rough glass to one facet only, as the formulas of glTF do: such surfaces lose up to 70 %
    /// of the light that they would return.
    #[arg(long)]
    pub no_energy_compensation: bool,
    /// Sky: an equirectangular .hdr or .exr, `uniform`, `sun:AZIMUTH,ELEVATION` in degrees, or
    /// `sun:DATE,TIME,LATITUDE,LONGITUDE[,UTC_OFFSET[,NORTH]]` such as sun:2026-06-21,14:30,48.14,11.58,2.
    #[arg(long, value_name = "FILE|uniform|sun:AZ,EL", value_parser = crate::look::sky::typed, allow_hyphen_values = true)]
    pub sky: Option<SkySetting>,
    /// Leave out no work that a scene does not need, or not the work of these names: slower, and the same picture.
    #[arg(long, value_name = "NAMES", num_args = 0..=1, require_equals = true, default_missing_value = "all",
        value_parser = Skips::all_but)]
    pub no_skip: Option<Skips>,
    /// What a look makes of the scene, beside what is typed.
    #[arg(skip)]
    pub of_look: SceneChoice,
    /// Seed of all random numbers.
    #[arg(long, value_name = "S", default_value_t = 0, allow_negative_numbers = true)]
    pub seed: u64,
    /// Threads to use [default: one per core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024),
        allow_negative_numbers = true)]
    pub threads: Option<u16>,
}

impl ViewArgs {
    /// The work that is left out.
    pub fn skips(&self) -> Skips {
        self.no_skip.unwrap_or_default()
    }

    /// The same with what a look makes of the scene.
    pub fn as_in(&self, look: &Look) -> ViewArgs {
        ViewArgs { of_look: look.scene.clone(), ..self.clone() }
    }

    /// What of a file is loaded.
    pub fn import_choice(&self) -> Choice {
        Choice { skips: self.skips(), variant: self.variant.clone() }
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
    /// Patches of the sky above the horizon [default: as the look says, else 145].
    #[arg(long, value_name = "145|577|2305", value_parser = parse_patches, allow_negative_numbers = true)]
    pub sky_patches: Option<SkyForm>,
    /// Signal to error in decibels that the bake aims at.
    #[arg(long, value_name = "DB", default_value_t = 40.0, value_parser = parse_tolerance,
        allow_negative_numbers = true)]
    pub tolerance: f32,
    /// Seconds that the bake may take, scene loading not counted: it goes over the picture with four times the samples each
    /// time, where the error is greatest first, and ends with what it has; --spp and --tolerance still end it sooner. A preview is
    /// always made whole, and with --exact the first pass over it as well; else the answer tells how many blocks are still those of
    /// the preview, with shared and clamped light.
    #[arg(long, value_name = "N", value_parser = parse_seconds, conflicts_with = "patches",
        allow_negative_numbers = true)]
    pub seconds: Option<Duration>,
    /// Share the light between surfaces among neighboring pixels: smoother at the same samples, but smeared over a few
    /// pixels; the error says by how much, as measured on pixels that are traced as well.
    #[arg(long, conflicts_with = "exact")]
    pub fast: bool,
    /// Follow the light between surfaces from every sample (the default), and take no noise out, neither between pixels nor within
    /// blocks: without bias but for what truncation leaves out. The yardstick for that, the singular value decomposition of each
    /// block's samples as they are, is --method svd --exact.
    #[arg(long)]
    pub exact: bool,
    /// Take no noise out between pixels. By default pixels that show the same surface tell each other, as far as two halves of the
    /// samples agree that it helps. Blocks that are noisier than asked are smoothed nevertheless, see --exact.
    #[arg(long, conflicts_with = "exact")]
    pub no_denoise: bool,
    /// Also bake how free lamps light the scene by way of its surfaces, told apart into about N patches (4096 will do, at most
    /// 16384): lamps of a look can then be moved and added after the bake. 0 is none, and all that `render` takes.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=i64::from(MOST_PATCHES)),
        allow_negative_numbers = true)]
    pub patches: u32,
    /// What makes factors of the samples: `projected` is our own, the others are there to be compared with, such as `svd`,
    /// `row-id`, `aca-full` or `alg4:qr`, block by block; a name that does not exist lists them all.
    #[arg(long, value_name = "NAME", default_value_t, value_parser = parse_method)]
    pub method: Method,
    /// Side of the blocks in pixels, each of which has a rank of its own.
    #[arg(long, value_name = "8|16|32", default_value_t = SIDE, value_parser = parse_block,
        allow_negative_numbers = true)]
    pub block: u32,
    /// Start over, even if an earlier bake of the same name was stopped half way or could be taken over. Of `bake` alone: `render`
    /// starts over each time.
    #[arg(long)]
    pub fresh: bool,
}

impl BakeOptions {
    /// In which patches the sky is baked under a look.
    pub fn sky_form(&self, look: &Look) -> SkyForm {
        let of_look = look.scene.sky.map(SkyForm::Patches);
        self.sky_patches.or(of_look).unwrap_or(SkyForm::Patches(1))
    }
}

/// Options that mean nothing to pictures that were taken: nothing is traced.
const OF_SCENES: [&str; 28] = [
    "scene",
    "look",
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
    "sun_size",
    "variant",
    "no_energy_compensation",
    "sky",
    "no_skip",
    "sky_patches",
    "fast",
    "exact",
    "no_denoise",
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
    /// Look whose panels, units of lamps, sky and, with --irradiance, work plane are baked, beside what is typed [default: as the scene
    /// says].
    #[arg(long, value_name = "FILE.look")]
    pub look: Option<PathBuf>,
    /// Transport file to write.
    #[arg(short, long, value_name = "FILE.transport", required_unless_present = "estimate")]
    pub output: Option<PathBuf>,
    /// Do not bake: try some blocks, and tell about how long it will take, how much memory, and how large the file will be.
    #[arg(long, conflicts_with_all = ["output", "seconds", "fresh"])]
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
    #[arg(long = "work-plane", value_name = "HEIGHT[:SPACING]", value_parser = parse_work_plane,
        allow_negative_numbers = true)]
    pub work_planes: Vec<WorkPlane>,
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
    /// every group of the look, and for lights without one per kind, `irradiance` adds irradiance.R, irradiance.G,
    /// irradiance.B: the light that arrives, in lux per channel. Several are set apart by commas.
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
    /// Samples of a pixel for what these lamps light, in pictures and sheets, not in frames: glints of polished surfaces take some hundreds.
    #[arg(long, value_name = "N", default_value_t = DEFAULT_SAMPLES, value_parser = clap::value_parser!(u32).range(1..=65_536),
        allow_negative_numbers = true)]
    pub lamp_samples: u32,
    /// Relight under each of these looks instead, and put the pictures on one sheet (PNG) with their names.
    #[arg(long, value_name = "FILE.look", num_args = 1..,
        conflicts_with_all = ["look", "name", "at", "preset", "frames", "fps"])]
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
    /// One per group of the look, and for lights without one per kind: lamps, luminous surfaces, panels, sky, unlit
    /// surfaces, free lamps.
    Groups,
    /// The light that arrives at what is seen.
    Irradiance,
}

#[cfg(test)]
mod tests;
