//! What light does before anyone edits it: glTF import, light transport by path tracing, and baking into block factors.
pub mod archive;
pub mod bake;
pub mod basis;
pub mod bsdf;
pub mod bvh;
pub mod camera;
pub mod emitters;
pub mod figures;
mod fingerprint;
pub mod import;
pub mod irradiance;
pub mod lamp_units;
#[cfg(test)]
mod laws;
pub mod light;
pub mod matrix;
mod nodes;
pub mod path;
pub mod photometry;
pub mod plan;
pub mod prepared;
pub mod sampler;
pub mod scene;
pub mod sensors;
mod shared;
pub mod sky;
pub mod texture;
pub mod trace;
