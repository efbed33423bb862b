//! Puts up organs, discs and balls.

use glam::DQuat;

use super::interpreter::Turtle;
use super::options::STALK;
use osier_grammar::Module;

impl Turtle<'_> {
    /// Prototypes of an organ symbol and the scale that gives it its size; made on first use.
    fn organ_protos(&mut self, c: char) -> Option<(u16, u16, f64)> {
        if let Some(&known) = self.organs.get(&c) {
            return Some(known);
        }
        let options = self.options;
        let spec = options.organs.get(&c).filter(|s| !s.meshes.is_empty())?;
        let first = u16::try_from(self.builder.protos.len()).ok()?;
        let mut longest = 0.0_f32;
        for (i, mesh) in spec.meshes.iter().enumerate() {
            let name = if spec.meshes.len() == 1 { spec.name.clone() } else { format!("{}_{i}", spec.name) };
            longest = longest.max(mesh.bounds().max.y);
            self.builder.protos.push(osier_scene::plant::Proto { name, mesh: std::sync::Arc::clone(mesh) });
        }
        let count = u16::try_from(spec.meshes.len()).ok()?;
        let scale = if longest > 1e-9 && longest.is_finite() { spec.size / f64::from(longest) } else { spec.size };
        self.organs.insert(c, (first, count, scale));
        Some((first, count, scale))
    }

    pub(super) fn organ(&mut self, c: char, size: f64, m: Module<'_>) {
        let Some((first, count, unit)) = self.organ_protos(c) else {
            let known: Vec<String> =
                self.options.organs.keys().filter(|k| **k != STALK).map(|k| format!("~{k}")).collect();
            let list = if known.is_empty() { "none is defined".to_owned() } else { known.join(", ") };
            let help = format!("known organs: {list}; define it in the scene");
            let name = if c == STALK { "stalk".to_owned() } else { format!("~{c}") };
            return self.remark("L048", (Some('~'), c), format!("organ '{name}' is unknown, nothing is drawn"), &help);
        };
        let scale = self.s.scale;
        let petiole = self.options.organs.get(&c).map_or(0.0, |s| s.petiole);
        let pose = (self.s.p, self.s.frame.quat());
        if m.params.len() < 3 {
            let size = size * scale;
            if size > 0.0 {
                self.place(pose, (first, count), (unit * size, petiole * size), m);
            }
            return;
        }
        let [x, y, z] = [0, 1, 2].map(|i| self.param(m, i, 1.0));
        if x > 0.0 && y > 0.0 && z > 0.0 {
            let pick = first + u16::try_from(m.lineage % u64::from(count.max(1))).unwrap_or(0);
            match self.shapes.stretched(&mut self.builder.protos, pick, [x / y, z / y]) {
                Some(proto) => self.place(pose, (proto, 1), (unit * y * scale, petiole * y * scale), m),
                None => self.no_room(c),
            }
        }
    }

    /// `@o`, `@c`, `@O`: discs and spheres.
    pub(super) fn round(&mut self, c: char, m: Module<'_>) {
        let d = self.param(m, 0, self.s.width / self.s.scale.max(1e-300));
        self.ball(c, d, m);
    }

    /// The same with a diameter in turtle units, before scaling.
    pub(super) fn ball(&mut self, c: char, d: f64, m: Module<'_>) {
        let d = d * self.s.scale * self.options.unit_m;
        let material = self.options.shape_material;
        let protos = &mut self.builder.protos;
        let proto = if c == 'O' { self.shapes.sphere(protos, material) } else { self.shapes.disc(protos, material) };
        let q = if c == 'o' { DQuat::IDENTITY } else { self.s.frame.quat() };
        match proto {
            Some(proto) if d > 0.0 => self.place((self.s.p, q), (proto, 1), (d, 0.0), m),
            Some(_) => {}
            None => self.no_room(c),
        }
    }
}
