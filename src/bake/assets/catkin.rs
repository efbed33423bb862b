//! Catkin models: tufts of hair grown from a grammar, in levels of detail from curves to crossed billboards.

use crate::bake::BakeContext;
use crate::bake::assets::material_set::MaterialSet;
use crate::bake::scene::builder::CATKINS_ID;
use crate::recipe::scene::{CatkinKeys, HairAngles, HairDistribution};
use glam::{Quat, Vec3};
use osier_base::Result;
use osier_base::convert::index;
use osier_base::diagnostic::Sources;
use osier_base::par::par_map;
use osier_base::rng::Rng;
use osier_base::units::degrees;
use osier_grammar::{DeriveOptions, Grammar, GrammarSource, derive, parse};
use osier_plants::grow::turtle::{self, TurtleOptions};
use osier_plants::surface::SurfaceMaterial;
use osier_plants::surface::catkin::{Tuft, TuftDetail, TuftSpec, VARIANTS, hair_material, stalk_material, tuft};
use osier_scene::plant::Plant;
use osier_scene::{Asset, AssetKind, InstanceState, Instancer, InstancerMotion, Mesh, Prototype};

/// Distance of catkins side by side, in radii of the largest: just over 2, so that they do not touch.
const SPACING_IN_RADII: f32 = 2.1;

/// Index among [`catkin_materials`] of the first billboard's material.
const FIRST_BILLBOARD: u32 = 2;

/// The first level of detail that shows billboards instead of hairs.
const FIRST_BILLBOARD_LOD: u32 = 4;

/// The level of detail that instances show, and the other levels written beside it, without repetition.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CatkinLods {
    shown: u32,
    others: Vec<u32>,
}

impl CatkinLods {
    /// The levels of the keys `lod` and `lods`.
    pub fn from_keys(keys: &CatkinKeys) -> Self {
        Self { shown: keys.lod, others: keys.lods.iter().copied().filter(|l| *l != keys.lod).collect() }
    }

    /// The levels that need materials of billboards, in the order in which [`catkin_materials`] adds these.
    fn billboard_lods(&self) -> impl Iterator<Item = u32> {
        std::iter::once(&self.shown).chain(&self.others).copied().filter(|l| *l >= FIRST_BILLBOARD_LOD)
    }
}

/// One kind of catkin. The hairs begin at the origin and the tuft opens towards +Y.
#[derive(Debug, Clone)]
pub struct CatkinModel {
    /// `p000`, `p001`, ...
    pub name: String,
    /// Radius of its bounding ball about the origin, m.
    pub radius: f32,
    /// Lowest y of the tuft, m, at most 0.
    pub lowest: f32,
    index: u32,
    /// Number of models of the scene: the stride between the billboard materials of two levels.
    count: u32,
    tuft: Tuft,
}

impl CatkinModel {
    /// The prototype of instances: the level shown, and the other levels as its alternatives. `first`: index in the scene of
    /// the first of [`catkin_materials`].
    pub fn prototype(&self, levels: &CatkinLods, first: u32) -> Prototype {
        // A single level is not named: its prototype is the catkin.
        let mut proto = self.level_prototype(levels.shown, levels, first);
        if !levels.others.is_empty() {
            let named = |lod: u32| Prototype { level: format!("lod{lod}"), ..self.level_prototype(lod, levels, first) };
            proto = Prototype { others: levels.others.iter().map(|l| named(*l)).collect(), ..named(levels.shown) };
        }
        proto
    }

    /// One level: 0 curves, 1 tubes, 2 ribbons, 3 fewer ribbons, 4 three crossed pictures, 5 one.
    fn level_prototype(&self, lod: u32, levels: &CatkinLods, first: u32) -> Prototype {
        let mut proto = match lod {
            0 => self.tuft.curves_prototype(&self.name),
            1 => Prototype::new(&self.name, self.tuft.mesh(TuftDetail::Tubes)),
            2 => Prototype::new(&self.name, self.tuft.mesh(TuftDetail::Ribbons)),
            3 => Prototype::new(&self.name, self.tuft.mesh(TuftDetail::Thinned)),
            _ => {
                // Materials of billboards are ordered by level, and within a level by model.
                let before = (0..).zip(levels.billboard_lods()).find(|(_, l)| *l == lod).map_or(0, |(i, _)| i);
                Prototype::new(
                    &self.name,
                    self.billboards(lod).0.with_material(FIRST_BILLBOARD + before * self.count + self.index),
                )
            }
        };
        proto.mesh.subsets.iter_mut().for_each(|s| s.material += first);
        // Hairs as curves are the finer form beside a mesh; both show the same materials.
        if let Some(fine) = &mut proto.fine {
            fine.mesh.subsets.iter_mut().for_each(|s| s.material += first);
            fine.curves.material += first;
        }
        proto
    }

    /// Renders the tuft to billboards: three crossed ones at level 4, one at level 5.
    fn billboards(&self, lod: u32) -> (Mesh, SurfaceMaterial) {
        self.tuft.billboards(&format!("catkin_{}", self.name), lod == 4)
    }

    /// Hairs and stalk at full detail; flights read the points of the hairs to lower deposited catkins onto their surface.
    pub fn tuft(&self) -> &Tuft {
        &self.tuft
    }
}

/// Materials of all catkins of a scene: hair, stalk, and a billboard picture for each model at each level that has one.
/// # Errors
/// `TooMany` beyond 2^32 images.
pub fn catkin_materials(models: &[CatkinModel], levels: &CatkinLods) -> Result<MaterialSet> {
    let mut look = MaterialSet::default();
    look.add(hair_material("catkin_hair"), Vec::new())?;
    look.add(stalk_material("catkin_stalk"), Vec::new())?;
    for lod in levels.billboard_lods() {
        for mut surface in par_map(models, |m| m.billboards(lod).1) {
            // Two levels of one model would have one name.
            if lod != levels.shown {
                surface.material.name += &format!("_lod{lod}");
                surface
                    .images
                    .iter_mut()
                    .for_each(|i| i.name = i.name.replacen("catkin_", &format!("catkin_lod{lod}_"), 1));
            }
            look.add(surface.material, surface.images)?;
        }
    }
    Ok(look)
}

/// Text of the grammar of one variant: eq. 1 and 2 of \[catkin\] with the angles of the keys, degrees.
fn variant_grammar_text(keys: &CatkinKeys, variant: usize) -> String {
    let (tilt, turn) = VARIANTS[variant % VARIANTS.len()];
    let (tilt, turn) = (keys.fluffiness.map_or(tilt, degrees), keys.bend.map_or(turn, degrees));
    // Angles of a grammar are in degrees.
    let delta = match keys.polar {
        HairDistribution::Tilt => format!("uniform(0,{tilt})"),
        // The cosine of the tilt is even between 1 and that of the largest.
        HairDistribution::SolidAngle => format!("acos(1-ran(1-cos({tilt})))"),
    };
    let (spin, gamma) = match keys.angles {
        HairAngles::Signed => (format!("uniform(0,{})", degrees(keys.spin)), format!("uniform({},{turn})", -turn)),
        HairAngles::Paper => ("delta".to_owned(), format!("uniform(0,{turn})")),
    };
    // The hairs are shared among the two starting symbols of eq. 1; an odd one goes to the first.
    let (p, q) = (keys.hairs.div_ceil(2), keys.hairs / 2);
    let rules: String = ["P", "Q"].map(|s| format!("{s} --> F@F'F\n{s} --> F@F-F\n{s} --> F-F#F\n")).concat();
    format!(
        "lsystem: catkin\nderivation length: 1\nturtle: catkin\ndefine-angle: delta = {delta} spin = {spin} gamma = {gamma}\n\
         bind F : forward {}\naxiom: repeat {p} {{ [*$P] }} repeat {q} {{ [*%Q] }}\n{rules}endlsystem\n",
        keys.section
    )
}

/// Grows the skeleton of one variant: an axis of four nodes for each hair.
/// # Errors
/// `Input` beyond a limit.
pub fn grow_skeleton(keys: &CatkinKeys, variant: usize, seed: u64, context: &BakeContext<'_>) -> Result<Plant> {
    context.cancel.check()?;
    let text = variant_grammar_text(keys, variant);
    // The generated text has no `#include`; a request for a file would be an error.
    let mut none =
        |reference: &str, _: &str| Err(osier_base::Error::io("open", reference, std::io::ErrorKind::NotFound.into()));
    let source = GrammarSource {
        name: "catkin",
        bytes: text.as_bytes(),
        includes: &mut none,
        defines: &std::collections::BTreeMap::new(),
        functions: Default::default(),
    };
    let (grammar, _): (Grammar, _) = parse(&mut Sources::default(), source, context.limits)?;
    let key = variant_seed(seed, variant);
    let derived = derive(&grammar, &DeriveOptions { seed: key, ..DeriveOptions::default() }, context.limits)?;
    let options =
        TurtleOptions { width: 2.0 * keys.hair_radius, radii: turtle::RadiusModel::Widths, ..TurtleOptions::default() };
    Ok(turtle::grow(&grammar, &derived, &options, context.limits)?.0)
}

fn variant_seed(seed: u64, variant: usize) -> u64 {
    Rng::key(seed, &["catkin".into(), (variant as u64).into()])
}

/// Builds the models of a scene's catkins, one per variant.
/// # Errors
/// `Input` beyond a limit, `Cancelled`.
pub fn catkin_models(keys: &CatkinKeys, seed: u64, context: &BakeContext<'_>) -> Result<Vec<CatkinModel>> {
    let spec = TuftSpec {
        jitter: keys.jitter,
        radius: keys.hair_radius,
        tip: keys.tip,
        smooth: keys.smooth,
        stalk: keys.stalk_radius,
        materials: [0, 1],
    };
    let variants: Vec<usize> = (0..keys.variants as usize).collect();
    let models = par_map(&variants, |v| {
        let tuft = tuft(&grow_skeleton(keys, *v, seed, context)?, &spec, variant_seed(seed, *v));
        let index = index(*v, "models of catkins")?;
        let (name, count) = (format!("p{v:03}"), keys.variants);
        Ok(CatkinModel { name, radius: tuft.radius, lowest: tuft.lowest, index, count, tuft })
    });
    models.into_iter().collect()
}

/// One catkin of each model side by side along +X around the origin, each standing on y = 0. `first`: as in
/// [`CatkinModel::prototype`].
/// # Errors
/// `TooMany` beyond 2^32 models.
pub fn side_by_side_asset(models: &[CatkinModel], levels: &CatkinLods, first: u32) -> Result<Asset> {
    let gap = SPACING_IN_RADII * models.iter().map(|m| m.radius).fold(0.0, f32::max);
    // The row is centered on the origin; the widest catkin sets the spacing of all.
    let middle = (models.len().saturating_sub(1)) as f32 * 0.5;
    let place = |(i, m): (usize, &CatkinModel)| Vec3::new((i as f32 - middle) * gap, -m.lowest, 0.0);
    let n = index(models.len(), "models of catkins")?;
    let instancer = Instancer {
        name: "catkins".into(),
        prototypes: models.iter().map(|m| m.prototype(levels, first)).collect(),
        ids: (0..u64::from(n)).collect(),
        protos: (0..n).collect(),
        scales: vec![Vec3::ONE; models.len()],
        rest: InstanceState {
            positions: models.iter().enumerate().map(place).collect(),
            orientations: vec![Quat::IDENTITY; models.len()],
            ..InstanceState::default()
        },
        motion: InstancerMotion::Still,
        tracked: false,
    };
    Ok(Asset {
        id: CATKINS_ID.into(),
        kind: AssetKind::Tracks,
        group: String::new(),
        skeleton: None,
        meshes: Vec::new(),
        instancers: vec![instancer],
        points: Vec::new(),
        curves: Vec::new(),
        rigged: None,
    })
}
