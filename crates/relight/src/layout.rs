//! Structs that Rust and WGSL share; a test asks naga for the size and the offsets of each.

use bytemuck::{Pod, Zeroable};

use crate::display::{DisplayParams, Dither, Spacing, Tone, WhitePoint};

/// `Block` in `blocks.wgsl`: one tile of a group. Positions count elements of their buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub(crate) struct Block {
    pub rank: u32,
    pub n_pixels: u32,
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub left: u32,
    pub z: u32,
    pub sparse: u32,
    pub n_sparse: u32,
    /// Components of the block, those included that fill the last word.
    pub n_components: u32,
    /// Components of the left factor that are halves; the rest are bytes.
    pub left_halves: u32,
    /// Its number among the tiles of the frame.
    pub tile: u32,
}

/// `Group` in `blocks.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Group {
    pub n_cols: u32,
    pub frame_width: u32,
    pub n_segments: u32,
    /// An [`ExpandMode`].
    pub mode: u32,
    /// Nit by which tiles may miss the exact answer; below 0 all of them are brought up to date.
    pub unseen: f32,
}

/// `mode` of a [`Group`]: what expand does with the radiance of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ExpandMode {
    /// Adds to the groups before.
    Add = 0,
    /// Sets it on top of the settled groups.
    Set = 1,
    /// Sets it alone.
    Put = 2,
}

/// `Display` in `display.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Display {
    pub width: u32,
    pub height: u32,
    pub tone: u32,
    pub gain: f32,
    /// Columns of the matrix of white balance, padded.
    pub balance: [[f32; 4]; 3],
    pub dither: u32,
    pub spacing: u32,
    pub scale_start: f32,
    pub scale_per_unit: f32,
    /// 1 where there is a layer to add.
    pub layered: u32,
    pub padding: [u32; 3],
}

impl Display {
    /// The parameters as the shader takes them.
    pub(crate) fn new(width: u32, height: u32, params: &DisplayParams, layered: Layered) -> Self {
        let rows = params.white.map_or(IDENTITY, WhitePoint::matrix);
        let spacing = params.false_color.map_or(0, |scale| match scale.spacing {
            Spacing::Log => 1,
            Spacing::Linear => 2,
        });
        let (scale_start, scale_per_unit) = params.false_color.map_or((0.0, 1.0), |scale| scale.line());
        Self {
            width,
            height,
            tone: match params.tone {
                Tone::Agx => 0,
                Tone::Aces => 1,
                Tone::Neutral => 2,
                Tone::Reinhard => 3,
                Tone::Linear => 4,
            },
            gain: params.gain(),
            balance: std::array::from_fn(|col| [rows[0][col], rows[1][col], rows[2][col], 0.0]),
            dither: u32::from(params.dither == Dither::Ordered),
            spacing,
            scale_start,
            scale_per_unit,
            layered: u32::from(layered == Layered::Yes),
            padding: [0; 3],
        }
    }
}

/// `Lamp` in `lamplight.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct LampRecord {
    pub kind: u32,
    pub width: u32,
    pub height: u32,
    pub sheer: u32,
    pub position: [f32; 3],
    pub area: f32,
    pub axis: [f32; 3],
    pub rim: f32,
    pub half_x: [f32; 3],
    pub per_cos: f32,
    pub half_y: [f32; 3],
    pub near: f32,
    pub emission: [f32; 3],
    pub far: f32,
    pub n_vertical: u32,
    pub n_horizontal: u32,
    pub planes: u32,
    pub distribution: u32,
}

/// Whether a layer is added to the radiance before it is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Layered {
    No,
    Yes,
}

/// White balance that changes nothing.
const IDENTITY: [[f32; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Source of a stage that works on blocks.
macro_rules! of_blocks {
    ($name:literal) => {
        concat!(include_str!("../shaders/blocks.wgsl"), include_str!(concat!("../shaders/", $name, ".wgsl")))
    };
}

/// Name and source of each stage.
pub(crate) const SHADERS: [(&str, &str); 4] = [
    ("project", of_blocks!("project")),
    ("gather", of_blocks!("gather")),
    ("expand", of_blocks!("expand")),
    ("display", include_str!("../shaders/display.wgsl")),
];

/// Name and source of the kernel that traces the light of free lamps.
pub(crate) const LAMPLIGHT: (&str, &str) = ("lamplight", include_str!("../shaders/lamplight.wgsl"));

/// Name and source of the kernel that the others are measured by.
pub(crate) const COPY: (&str, &str) = ("copy", include_str!("../shaders/copy.wgsl"));

/// Threads of a workgroup of `project`, `gather` and `expand`.
pub(crate) const THREADS: u32 = 64;

/// Threads that share a block in `gather`.
pub(crate) const PER_BLOCK: u32 = 8;

/// Components of a thread in `project`.
pub(crate) const COMPONENTS: u32 = 4;

/// Pixels along each side of what a workgroup of `display` shows: devices begin only so many workgroups at a time.
pub(crate) const SHOWN: u32 = 16;

/// Pixels of a thread in `expand`.
pub(crate) const PIXELS: u32 = 4;

/// Workgroups of a row of a grid: WebGPU promises 65,535 of every device.
pub(crate) const ROW: u32 = 32_768;

/// Columns of a segment, as in `project.wgsl`.
pub(crate) const SEGMENT: u32 = 128;

/// Columns that `project` reads at a time, of halves and of bytes.
pub(crate) const AT_A_TIME: [u32; 2] = [8, 16];

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::{offset_of, size_of};

    /// Name, size, and offset of each member.
    type Shape = (&'static str, usize, Vec<(&'static str, usize)>);

    macro_rules! shape {
        ($name:ident: $($member:ident),*) => {
            (stringify!($name), size_of::<$name>(), vec![$((stringify!($member), offset_of!($name, $member))),*])
        };
    }

    /// What shaders hand from one of their functions to the other.
    const OF_SHADERS: [&str; 8] = ["Sent", "Shear", "LampPoint", "Route", "Met", "Walk", "Crossing", "Passed"];

    fn shapes() -> Vec<Shape> {
        vec![
            shape!(Block: rank, n_pixels, x, y, width, left, z, sparse, n_sparse, n_components, left_halves, tile),
            shape!(Group: n_cols, frame_width, n_segments, mode, unseen),
            shape!(Display: width, height, tone, gain, balance, dither, spacing, scale_start, scale_per_unit, layered),
            (
                "Lamp",
                size_of::<LampRecord>(),
                shape!(LampRecord: kind, width, height, sheer, position, area, axis, rim, half_x, per_cos, half_y, near, emission, far,
                    n_vertical, n_horizontal, planes, distribution).2,
            ),
        ]
    }

    #[test]
    fn every_shader_is_valid_and_has_its_entry_point() {
        use naga::valid::{Capabilities, ValidationFlags, Validator};
        for (name, source) in SHADERS.into_iter().chain([LAMPLIGHT, COPY]) {
            let module =
                naga::front::wgsl::parse_str(source).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
            let info =
                Validator::new(ValidationFlags::all(), Capabilities::SHADER_FLOAT16_IN_FLOAT32).validate(&module);
            info.unwrap_or_else(|e| panic!("{name}: {e:?}"));
            assert!(
                module.entry_points.iter().any(|e| e.name == name && e.stage == naga::ShaderStage::Compute),
                "{name}"
            );
        }
    }

    #[test]
    fn structs_have_the_same_layout_in_rust_and_wgsl() {
        let mut n_checked = 0;
        for (file, source) in SHADERS.into_iter().chain([LAMPLIGHT]) {
            let module = naga::front::wgsl::parse_str(source).unwrap();
            for (_, ty) in module.types.iter() {
                let naga::TypeInner::Struct { members, span } = &ty.inner else { continue };
                let name = ty.name.as_deref().unwrap();
                if OF_SHADERS.contains(&name) {
                    continue;
                }
                let shape = shapes().into_iter().find(|s| s.0 == name);
                let (_, size, expected) = shape.unwrap_or_else(|| panic!("{file}: {name} has no twin in Rust"));
                let found: Vec<_> = members.iter().map(|m| (m.name.as_deref().unwrap(), m.offset as usize)).collect();
                assert_eq!((*span as usize, found), (size, expected), "{file}: {name}");
                n_checked += 1;
            }
        }
        assert_eq!(n_checked, 8);
    }
}
