//! Work that a scene does not need: each kind of it has a switch, so that what leaving it out saves can be measured, and that it
//! changes no picture can be tested.
//!
//! What is left out is found by looking at the scene, never by chance: either it could not have changed a number, or what
//! chance leaves out is made up for by weights (`docs/method.md`).

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A kind of work that can be left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Skip {
    /// Rays of pixels that no triangle covers.
    EmptyPixels,
    /// Coats, metal and transmission of materials that are diffuse and nothing else: code and random numbers.
    Lobes,
    /// Asking opaque surfaces for their alpha.
    Alpha,
    /// Connections to sky, sun and directional lamps from a room that is closed.
    ClosedSky,
    /// Connections to lamps and panels behind closed walls, that look away from everything, or that are never on.
    DarkLamps,
    /// Connections to patches of the sky of which pilot pixels saw nothing.
    UnseenPatches,
    /// Most of the later connections that carry little.
    WeakLight,
    /// Samples of blocks that are exact enough.
    ConvergedBlocks,
    /// Images whose texels are multiplied by 0 everywhere, or that nothing visible uses.
    IdleTextures,
    /// Columns that an earlier bake of the same surfaces, view and settings has.
    Reuse,
}

impl Skip {
    /// All of them.
    pub const ALL: [Skip; 10] = [
        Skip::EmptyPixels,
        Skip::Lobes,
        Skip::Alpha,
        Skip::ClosedSky,
        Skip::DarkLamps,
        Skip::UnseenPatches,
        Skip::WeakLight,
        Skip::ConvergedBlocks,
        Skip::IdleTextures,
        Skip::Reuse,
    ];

    /// Its name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Skip::EmptyPixels => "empty-pixels",
            Skip::Lobes => "lobes",
            Skip::Alpha => "alpha",
            Skip::ClosedSky => "closed-sky",
            Skip::DarkLamps => "dark-lamps",
            Skip::UnseenPatches => "unseen-patches",
            Skip::WeakLight => "weak-light",
            Skip::ConvergedBlocks => "converged-blocks",
            Skip::IdleTextures => "idle-textures",
            Skip::Reuse => "reuse",
        }
    }
}

/// Which work is left out: all that can be, unless told otherwise. In files it is the list of what is *not* left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Vec<Skip>", into = "Vec<Skip>")]
pub struct Skips {
    /// A bit for each skip that is off.
    off: u16,
}

/// A skip that does not exist.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("nothing that can be skipped is called `{name}`; write `all`, or some of: {}", Skip::ALL.map(Skip::name).join(", "))]
pub struct UnknownSkip {
    /// What was asked for.
    pub name: String,
}

impl Skips {
    /// Nothing is left out.
    pub fn none() -> Skips {
        Skip::ALL.into_iter().fold(Skips::default(), Skips::without)
    }

    /// All but those of a list: `all`, or names with commas between them.
    ///
    /// # Errors
    /// A name that no skip has.
    pub fn all_but(names: &str) -> Result<Skips, UnknownSkip> {
        if names == "all" {
            return Ok(Skips::none());
        }
        let skip = |name: &str| Skip::ALL.into_iter().find(|skip| skip.name() == name);
        names.split(',').map(str::trim).try_fold(Skips::default(), |skips, name| {
            skip(name).map(|skip| skips.without(skip)).ok_or_else(|| UnknownSkip { name: name.to_owned() })
        })
    }

    /// The same with one more off.
    pub fn without(self, skip: Skip) -> Skips {
        Skips { off: self.off | 1 << skip as u16 }
    }

    /// Whether such work is left out.
    #[inline]
    pub fn has(self, skip: Skip) -> bool {
        self.off & 1 << skip as u16 == 0
    }

    /// Whether all work is left out that can be.
    pub fn is_all(&self) -> bool {
        self.off == 0
    }

    /// Those that are off.
    pub fn off(self) -> Vec<Skip> {
        Skip::ALL.into_iter().filter(|skip| !self.has(*skip)).collect()
    }
}

impl From<Vec<Skip>> for Skips {
    fn from(off: Vec<Skip>) -> Skips {
        off.into_iter().fold(Skips::default(), Skips::without)
    }
}

impl From<Skips> for Vec<Skip> {
    fn from(skips: Skips) -> Vec<Skip> {
        skips.off()
    }
}

/// What a look at the scene, before the first sample, found needless.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Spared {
    /// Pixels that no triangle covers.
    pub empty_pixels: u32,
    /// Materials that are diffuse and nothing else.
    pub diffuse_materials: u32,
    /// Share of the area of all surfaces that such materials have.
    pub diffuse_share: f32,
    /// Triangles that rays pass without asking for alpha.
    pub opaque_triangles: u32,
    /// Share of the area of all surfaces that these have.
    pub opaque_share: f32,
    /// Sources of the basis that nothing is lit by, in order.
    pub dark_sources: Vec<u32>,
    /// Share of the later connections that is left out as they carry little, in a few pixels.
    pub weak_connections: f32,
    /// Images that were not decoded, and the bytes of their texels as far as their size was at hand.
    pub idle_images: u32,
    /// See `idle_images`.
    pub idle_bytes: u64,
    /// Columns that were taken over from an earlier bake.
    pub reused_columns: u32,
}

impl Spared {
    /// Whether there was nothing needless.
    pub fn is_nothing(&self) -> bool {
        *self == Spared::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_names_is_what_is_not_skipped() {
        let skips = Skips::all_but("lobes, closed-sky").expect("both exist");
        assert_eq!(skips.off(), [Skip::Lobes, Skip::ClosedSky]);
        assert!(skips.has(Skip::Alpha) && !skips.has(Skip::Lobes) && !skips.is_all());
        assert_eq!(Skips::all_but("all"), Ok(Skips::none()));
        assert!(Skip::ALL.into_iter().all(|skip| !Skips::none().has(skip)));
        let unknown = Skips::all_but("lobes,color").expect_err("no such skip").to_string();
        assert!(unknown.contains("`color`") && unknown.contains("weak-light"), "{unknown}");
    }

    #[test]
    fn switches_come_back_out_of_a_file_under_the_names_of_the_command_line() {
        for skip in Skip::ALL {
            let json = serde_json::to_string(&Skips::default().without(skip)).expect("it has a JSON form");
            assert_eq!(json, format!("[\"{}\"]", skip.name()));
            assert_eq!(serde_json::from_str::<Skips>(&json).expect("it was just written").off(), [skip]);
        }
        assert!(serde_json::from_str::<Skips>("[\"color\"]").is_err());
    }
}
