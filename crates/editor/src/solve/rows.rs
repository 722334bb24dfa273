//! Means over parts of the picture as linear functions of the lights.

use anyhow::{Context, Result, bail};
use clerestory_nystrom::BlockLowRank;
use clerestory_relight::weighed_row;
use clerestory_transport::light::LightRig;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::lights::{Unknown, unit_rig};
use super::{LampColumn, Scene};
use crate::marks::weighed;

/// A mean, RGB: what stays, and what each unknown brings at 1.
#[derive(Clone, Debug)]
pub(super) struct Row {
    pub fixed: [f64; 3],
    pub shares: Vec<[f64; 3]>,
}

impl Row {
    /// Adds what columns bring to their owner.
    fn add(&mut self, owner: Option<usize>, sums: &[[f32; 3]], coefficients: &[[f32; 3]]) {
        let to = owner.map_or(&mut self.fixed, |owner| &mut self.shares[owner]);
        for (sum, x) in sums.iter().zip(coefficients) {
            (0..3).for_each(|c| to[c] += f64::from(sum[c]) * f64::from(x[c]));
        }
    }
}

/// Luminance of the channels.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

pub(super) fn luminance(rgb: [f64; 3]) -> f64 {
    (0..3).map(|c| LUMINANCE[c] * rgb[c]).sum()
}

/// Sources of rows.
pub(super) struct Rows<'a> {
    scene: &'a Scene,
    unknowns: &'a [Unknown],
    /// The picture's matrices as they are lit.
    groups: Vec<BlockLowRank>,
    coefficients: Vec<[f32; 3]>,
    /// For each set of irradiance.
    of_irradiance: Vec<Vec<[f32; 3]>>,
    /// The unknown that a column belongs to.
    owners: Vec<Option<usize>>,
    first_patch: usize,
    /// A sun that shines from columns of the sky.
    sun: Option<OfSun>,
}

/// What a sun brings that shines from columns of the sky: all columns together, with it alone.
struct OfSun {
    owner: Option<usize>,
    groups: Vec<BlockLowRank>,
    coefficients: Vec<[f32; 3]>,
    of_irradiance: Vec<Vec<[f32; 3]>>,
}

impl<'a> Rows<'a> {
    pub fn new(scene: &'a Scene, unknowns: &'a [Unknown]) -> Rows<'a> {
        let header = &scene.bake.header;
        let unit = unit_rig(&scene.rig, unknowns);
        let flat = |groups: Vec<Vec<[f32; 3]>>| -> Vec<[f32; 3]> { groups.into_iter().flatten().collect() };
        let of_irradiance = |rig: &LightRig| -> Vec<Vec<[f32; 3]>> {
            (0..header.irradiance.len()).map(|set| flat(header.irradiance_coefficients(set, rig))).collect()
        };
        let owner_of = |key: &str| unknowns.iter().position(|unknown| unknown.key == key);
        let mut owners = vec![None; header.basis.n_cols()];
        for source in &header.basis.sources {
            owners[source.columns.start as usize..source.columns.end as usize].fill(owner_of(&source.key));
        }
        let apart = header.basis.sun_apart(&unit);
        let by_column = apart.as_ref().map_or(&unit, |sun| &sun.without);
        Rows {
            scene,
            unknowns,
            groups: scene.bake.groups_under(by_column),
            coefficients: flat(header.coefficients(by_column)),
            of_irradiance: of_irradiance(by_column),
            first_patch: header.basis.patch_columns().map_or(owners.len(), |columns| columns.start as usize),
            owners,
            sun: apart.as_ref().map(|sun| OfSun {
                owner: owner_of(&sun.source.key),
                groups: scene.bake.groups_under(&sun.alone),
                coefficients: flat(header.coefficients(&sun.alone)),
                of_irradiance: of_irradiance(&sun.alone),
            }),
        }
    }

    /// The mean radiance over some pixels, nit.
    pub fn radiance(&self, pixels: &[u32]) -> Result<Row> {
        self.of_radiance(&weighed(pixels, self.scene.seen.as_deref()))
    }

    /// The same for many parts of the picture, all pixels of each alike, as a picture has them that these are held against.
    pub fn radiances(&self, parts: &[Vec<u32>]) -> Result<Vec<Row>> {
        parts.par_iter().map(|pixels| self.of_radiance(&weighed(pixels, None))).collect()
    }

    /// The sum of the radiance of some pixels, each times its weight.
    fn of_radiance(&self, pixels: &[(u32, f32)]) -> Result<Row> {
        let sums_of = |groups: &[BlockLowRank]| -> Result<Vec<[f32; 3]>> {
            let sums = weighed_row(groups, pixels.iter().copied()).context(NOT_BAKED)?;
            Ok(sums.into_iter().flatten().collect())
        };
        let sums = sums_of(&self.groups)?;
        let mut row = self.reduced(&sums, &self.coefficients);
        if let Some(sun) = &self.sun {
            row.add(sun.owner, &sums_of(&sun.groups)?, &sun.coefficients);
        }
        for lamp in &self.scene.lamps {
            self.add_lamp(&mut row, (lamp, &*lamp.direct), pixels, &sums);
        }
        Ok(row)
    }

    /// The mean irradiance over some pixels, lux; free lamps count where it is known what arrives of them.
    pub fn irradiance(&self, pixels: &[u32]) -> Result<Row> {
        let Some(set) = self.scene.bake.pixel_irradiance() else {
            bail!(
                "the bake holds no irradiance of its pixels; bake it again with --irradiance, in the window with Illuminance"
            );
        };
        let pixels = weighed(pixels, self.scene.seen.as_deref());
        let (mut row, sums) = self.of_set(set, &pixels)?;
        for lamp in &self.scene.lamps {
            if let Some(arriving) = &lamp.arriving {
                self.add_lamp(&mut row, (lamp, &**arriving), &pixels, &sums);
            }
        }
        Ok(row)
    }

    /// The mean irradiance over a sensor grid, lux.
    pub fn grid(&self, set: usize) -> Result<Row> {
        let grid = self.scene.bake.grids().find(|(of_grid, _)| *of_grid == set);
        let (_, grid) = grid.context("the bake has no such sensor grid")?;
        let measured: Vec<u32> = (0..grid.n_points() as u32).filter(|number| grid.point(*number).is_some()).collect();
        let points = weighed(&measured, None);
        let (mut row, sums) = self.of_set(set, &points)?;
        for lamp in &self.scene.lamps {
            let straight = |number| grid.point(number).map_or(Vec3::ZERO, |point| (lamp.at_point)(point, grid.normal));
            self.add_lamp(&mut row, (lamp, &straight), &points, &sums);
        }
        Ok(row)
    }

    /// What the lights of the scene bring, and the sums of the columns.
    fn of_set(&self, set: usize, pixels: &[(u32, f32)]) -> Result<(Row, Vec<[f32; 3]>)> {
        let groups = self.scene.bake.irradiance.get(set).context(NOT_BAKED)?;
        let sums = weighed_row(groups, pixels.iter().copied()).context(NOT_BAKED)?;
        let sums: Vec<[f32; 3]> = sums.into_iter().flatten().collect();
        let mut row = self.reduced(&sums, &self.of_irradiance[set]);
        if let Some(sun) = &self.sun {
            row.add(sun.owner, &sums, &sun.of_irradiance[set]);
        }
        Ok((row, sums))
    }

    /// Columns times their coefficients, summed by owner.
    fn reduced(&self, sums: &[[f32; 3]], coefficients: &[[f32; 3]]) -> Row {
        let mut row = Row { fixed: [0.0; 3], shares: vec![[0.0; 3]; self.unknowns.len()] };
        for ((sum, x), owner) in sums.iter().zip(coefficients).zip(&self.owners) {
            row.add(*owner, &[*sum], &[*x]);
        }
        row
    }

    /// A free lamp is known as it shines: what it brings at 1 is that over what it is set to.
    fn add_lamp(
        &self,
        row: &mut Row,
        (lamp, straight): (&LampColumn, &dyn Fn(u32) -> Vec3),
        pixels: &[(u32, f32)],
        sums: &[[f32; 3]],
    ) {
        let mut light = DVec3::ZERO;
        for &(pixel, weight) in pixels {
            light += straight(pixel).as_dvec3() * f64::from(weight);
        }
        for (sum, x) in sums[self.first_patch..].iter().zip(&lamp.of_patches) {
            light += Vec3::from(*sum).as_dvec3() * x.as_dvec3();
        }
        let owner = self.unknowns.iter().position(|unknown| unknown.key == lamp.key);
        let (to, present) = match owner {
            Some(owner) => (&mut row.shares[owner], self.unknowns[owner].present()),
            None => (&mut row.fixed, vec![1.0]),
        };
        for c in 0..3 {
            to[c] += light[c] / present.get(c).or(present.first()).copied().unwrap_or(1.0);
        }
    }
}

const NOT_BAKED: &str = "a part of the picture is not baked yet; wait for the bake, or open a finished one";
