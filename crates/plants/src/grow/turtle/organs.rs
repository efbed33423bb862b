//! Commands that place organs, discs and spheres.

use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::builder::{OrganSize, ProtoRange};
use super::frame::TurtlePose;
use super::interpreter::{OrganPrototypes, Turtle};
use super::options::STALK;
use super::paint::{Paint, TURTLE_COLOR};
use osier_grammar::Module;
use osier_scene::Mesh;

impl Turtle<'_> {
    /// Prototypes of an organ symbol, registered on first use; `None` if it is unknown or its prototypes cannot be indexed.
    fn organ_prototypes(&mut self, c: char) -> Option<OrganPrototypes> {
        let options = self.options;
        let spec = options.organs.get(&c).filter(|s| !s.meshes.is_empty())?;
        // Surfaces that take the turtle's colour have prototypes for each colour.
        let wears = |mesh: &Arc<Mesh>| mesh.subsets.iter().any(|s| s.material == TURTLE_COLOR);
        let painted = spec.meshes.iter().any(wears);
        let paint = painted.then(|| Paint::leaf(self.worn_color()));
        let key = (c, paint.map(|p| p.index));
        if let Some(&known) = self.organs.get(&key) {
            return Some(known);
        }
        let first = u16::try_from(self.builder.protos.len()).ok()?;
        // Register all variants as consecutive prototypes. They share one scale, so that the longest has the size
        // asked for and the others keep their proportions to it.
        let mut longest = 0.0_f32;
        for (i, mesh) in spec.meshes.iter().enumerate() {
            let name = match paint {
                Some(_) => format!("{}_{}", spec.name, self.builder.protos.len()),
                None if spec.meshes.len() == 1 => spec.name.clone(),
                None => format!("{}_{i}", spec.name),
            };
            longest = longest.max(mesh.bounds().max.y);
            let mut mesh = Arc::clone(mesh);
            if let Some(paint) = paint.filter(|_| wears(&mesh)) {
                let subsets = &mut Arc::make_mut(&mut mesh).subsets;
                subsets.iter_mut().filter(|s| s.material == TURTLE_COLOR).for_each(|s| s.material = paint.material());
            }
            self.builder.protos.push(osier_scene::plant::Proto { name, mesh });
        }
        let count = u16::try_from(spec.meshes.len()).ok()?;
        let scale = if longest > 1e-9 && longest.is_finite() { spec.size / f64::from(longest) } else { spec.size };
        let organ = OrganPrototypes { range: ProtoRange { first, count }, scale };
        self.organs.insert(key, organ);
        Some(organ)
    }

    /// Places organ `c`. `size`: its parameter. Three parameters stretch it along left, heading and up.
    pub(super) fn organ(&mut self, c: char, size: f64, m: Module<'_>) {
        let Some(OrganPrototypes { range, scale: unit }) = self.organ_prototypes(c) else {
            let known: Vec<String> =
                self.options.organs.keys().filter(|k| **k != STALK).map(|k| format!("~{k}")).collect();
            let list = if known.is_empty() { "none is defined".to_owned() } else { known.join(", ") };
            let help = format!("known organs: {list}; define it in the scene");
            let name = if c == STALK { "stalk".to_owned() } else { format!("~{c}") };
            return self.warn("L048", (Some('~'), c), format!("organ '{name}' is unknown, nothing is drawn"), &help);
        };
        let scale = self.s.scale;
        let petiole = self.options.organs.get(&c).map_or(0.0, |s| s.petiole);
        let pose = self.pose();
        if m.params.len() < 3 {
            let size = size * scale;
            if size > 0.0 {
                self.place_organ(pose, range, OrganSize { scale: unit * size, petiole: petiole * size }, m);
                self.move_to_organ_end(c, DVec3::splat(unit * size), m);
            }
            return;
        }
        // Three parameters: a stretched prototype of ratios x/y and z/y, scaled by y. The lineage picks the variant,
        // since prototypes are chosen before they are stretched.
        let [x, y, z] = [0, 1, 2].map(|i| self.param(m, i, 1.0) * self.growth.size);
        if x > 0.0 && y > 0.0 && z > 0.0 {
            let pick = range.pick(m.lineage());
            match self.shape_prototypes.stretched(&mut self.builder.protos, pick, [x / y, z / y]) {
                Some(proto) => {
                    let size = OrganSize { scale: unit * y * scale, petiole: petiole * y * scale };
                    self.place_organ(pose, ProtoRange::single(proto), size, m);
                    self.move_to_organ_end(c, DVec3::new(x, y, z) * (unit * scale), m);
                }
                None => self.too_many_prototypes(c),
            }
        }
    }

    /// Moves the turtle to the end point of the organ that it has placed, if there is one. What is drawn next begins a new axis.
    fn move_to_organ_end(&mut self, c: char, scale: DVec3, m: Module<'_>) {
        if let Some(end) = self.options.organ_ends.get(&c) {
            self.jump(self.pose().q * (*end * scale), m);
        }
    }

    /// `@o`, `@c`, `@O`: places a disc or a sphere; without a parameter its diameter is the line width.
    pub(super) fn disc_or_sphere(&mut self, c: char, m: Module<'_>) {
        let d = self.param(m, 0, self.s.width / self.s.scale.max(1e-300));
        self.place_disc_or_sphere(c, d, m);
    }

    /// A disc facing the viewer (`o`), a disc in the turtle's frame (`c`) or a sphere (`O`) of diameter `d`, turtle units.
    pub(super) fn place_disc_or_sphere(&mut self, c: char, d: f64, m: Module<'_>) {
        let d = d * self.s.scale * self.options.unit_m * self.growth.size;
        let material = self.shape_material(c != 'O');
        let protos = &mut self.builder.protos;
        let proto = if c == 'O' {
            self.shape_prototypes.sphere(protos, material)
        } else {
            self.shape_prototypes.disc(protos, material)
        };
        let q = if c == 'o' { DQuat::IDENTITY } else { self.s.frame.quat() };
        match proto {
            Some(proto) if d > 0.0 => {
                let size = OrganSize { scale: d, petiole: 0.0 };
                self.place_organ(TurtlePose { p: self.s.p, q }, ProtoRange::single(proto), size, m);
            }
            Some(_) => {}
            None => self.too_many_prototypes(c),
        }
    }
}
