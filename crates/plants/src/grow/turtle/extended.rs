//! Commands beyond the textbook: generalised cylinders, rings, patches, textures.

use glam::{DQuat, DVec3};

use super::builder::{OrganSize, ProtoRange};
use super::cylinders::{CurveKind, CylinderOrigin, CylinderPoint, OpenCylinder, STRIPS, TANGENT, frame_rotation};
use super::frame::TurtlePose;
use super::interpreter::Turtle;
use super::paint::Paint;
use super::patches::{PatchBasis, TurtlePatch};
use osier_base::math;
use osier_base::units::radians;
use osier_grammar::Module;
use osier_grammar::companion::{SurfaceFile, SurfacePatch};
use osier_scene::MaterialId;

/// Most quads along a side of a patch.
const MAX_QUADS: f64 = 64.0;

impl Turtle<'_> {
    /// Performs the command of `@G`, `@b` or `@P` with the second letter `c`; false if there is no such command.
    pub(super) fn extended_command(&mut self, first: char, c: char, m: Module<'_>) -> bool {
        match (first, c) {
            ('G', 's') => {
                self.finish_cylinder(m);
                self.open_cylinder(OpenCylinder::new(CurveKind::Hermite, false), m);
                self.cylinder_point(1);
            }
            ('G', 'c') => {
                let strips = self.strips(m, 1);
                self.cylinder_point(strips);
            }
            ('G', 'e') => {
                let strips = self.strips(m, 1);
                self.cylinder_point(strips);
                self.finish_cylinder(m);
            }
            ('G', 't') => {
                // A single number applies to both sides.
                let a = self.param(m, 0, TANGENT[0]);
                let b = self.param(m, 1, if m.params.is_empty() { TANGENT[1] } else { a });
                self.rare.cylinder.tangent = [a, b];
            }
            ('G', 'r') => match m.params.len() {
                0 => (self.rare.cylinder.slopes, self.rare.cylinder.relative) = (None, false),
                1 => self.rare.cylinder.relative = self.param(m, 0, 0.0).abs() > 0.0,
                _ => {
                    // A tangent of length l at the angle a to the axis changes the radius by l sin(a).
                    let [a1, l1] = [0, 1].map(|i| self.param(m, i, 0.0));
                    // Two numbers apply to both sides.
                    let [a2, l2] = [2, 3].map(|i| self.param(m, if m.params.len() < 4 { i - 2 } else { i }, 0.0));
                    let slope = |angle: f64, length: f64| length * math::sin(radians(angle));
                    self.rare.cylinder.slopes = Some([slope(a1, l1), slope(a2, l2)]);
                }
            },
            ('b', 'o' | 'c') => self.ring(c, m),
            ('P', 'S') => {
                let [id, basis] = [self.param(m, 0, 0.0), self.param(m, 1, 1.0)];
                let basis = match basis {
                    b if (1.5..2.5).contains(&b) => PatchBasis::BSpline,
                    b if b >= 2.5 => PatchBasis::Cardinal,
                    _ => PatchBasis::Bezier,
                };
                self.patches.insert(number(id), TurtlePatch { basis, points: [[DVec3::ZERO; 4]; 4] });
            }
            ('P', 'C') => {
                let [id, row, column] = [0, 1, 2].map(|i| self.param(m, i, 0.0));
                let p = self.s.p;
                let points = self.patches.get_mut(&number(id)).map(|patch| &mut patch.points);
                match points.and_then(|rows| rows.get_mut(number(row) as usize)?.get_mut(number(column) as usize)) {
                    Some(point) => *point = p,
                    None => self.unknown_patch(id),
                }
            }
            ('P', 'D') => self.draw_patch(m),
            _ => return false,
        }
        true
    }

    fn unknown_patch(&mut self, id: f64) {
        let message = format!("patch {id} has no such point");
        let help = "begin a patch with @PS(id,type); its rows and columns are 0 to 3";
        self.warn("L048", (Some('@'), 'P'), message, help);
    }

    /// The first parameter as a number of strips, 1 to 1000, or else `default`.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
    pub(super) fn strips(&mut self, m: Module<'_>, default: u32) -> u32 {
        self.param(m, 0, f64::from(default)).clamp(1.0, 1000.0) as u32
    }

    /// The first parameter as a whole number from 0 up, or else `default`.
    pub(super) fn strips_or(&mut self, m: Module<'_>, default: u32) -> u32 {
        number(self.param(m, 0, f64::from(default)))
    }

    /// Opens a cylinder that the module begins at this bracket level; an unfinished one there is dropped.
    pub(super) fn open_cylinder(&mut self, cylinder: OpenCylinder, m: Module<'_>) {
        let origin = CylinderOrigin { symbol: m.symbol, lineage: m.lineage(), birth: m.birth };
        if let Some(slot) = self.cylinders.last_mut() {
            *slot = Some(OpenCylinder { origin, ..cylinder });
        }
    }

    /// The unfinished cylinder that has begun, or been continued, at this bracket level.
    pub(super) fn cylinder(&self) -> Option<&OpenCylinder> {
        self.cylinders.last().and_then(Option::as_ref).filter(|c| !c.inherited)
    }

    /// Begins a bracket level, which may continue the cylinder of the level around it.
    pub(super) fn push_cylinder(&mut self) {
        let around = self.cylinders.last().and_then(Option::as_ref);
        let inherited = around.and_then(OpenCylinder::inheritance);
        self.cylinders.push(inherited);
    }

    /// Draws the cylinders of all bracket levels whose end the string does not mark.
    pub(super) fn finish_cylinders(&mut self) {
        while let Some(open) = self.cylinders.last() {
            if let Some(CylinderOrigin { symbol, lineage, birth }) = open.as_ref().map(|c| c.origin) {
                self.finish_cylinder(Module::new(symbol, &[], lineage, birth));
            }
            self.cylinders.pop();
        }
    }

    /// Adds the turtle's position to the unfinished cylinder of this bracket level, if there is one. Warns (L048) of an unknown
    /// contour.
    pub(super) fn cylinder_point(&mut self, strips: u32) {
        if self.cylinders.last().is_none_or(Option::is_none) {
            return;
        }
        let state = self.rare.cylinder;
        let closed = self.contours.get(&state.contour).is_none_or(|c| c.closed);
        if state.contour != 0 && !self.contours.contains_key(&state.contour) {
            let known: Vec<String> = self.contours.keys().map(u32::to_string).collect();
            let list = if known.is_empty() { "none is defined".to_owned() } else { known.join(", ") };
            let message = format!("contour {} is unknown, a circle is drawn", state.contour);
            self.warn("L048", (Some('@'), '#'), message, &format!("known contours: {list}"));
        }
        let material = self.shape_material(!closed);
        let radius = 0.5 * self.s.width * self.options.unit_m;
        let point = CylinderPoint { p: self.s.p, frame: self.s.frame, radius, state, strips, material };
        if let Some(Some(cylinder)) = self.cylinders.last_mut() {
            cylinder.points.push(point);
            cylinder.inherited = false;
        }
    }

    /// Ends and draws the unfinished cylinder of this bracket level, if there is one.
    pub(super) fn finish_cylinder(&mut self, m: Module<'_>) {
        let cylinder = self.cylinders.last_mut().and_then(Option::take);
        let Some(cylinder) = cylinder else { return };
        let Some(first) = cylinder.points.first() else { return };
        let pose = TurtlePose { p: first.p, q: frame_rotation(&first.frame) };
        let Some((mesh, size)) = cylinder.mesh(&self.contours, self.options.twist, pose) else { return };
        match self.shape_prototypes.surface(&mut self.builder.protos, "cylinder", mesh) {
            Some(proto) => {
                self.place_organ(pose, ProtoRange::single(proto), OrganSize { scale: size, petiole: 0.0 }, m)
            }
            None => self.too_many_prototypes('@'),
        }
    }

    /// Begins the shape that `{` opens: with parameter 1 to 4 a spline, otherwise a polygon.
    pub(super) fn open_shape(&mut self, m: Module<'_>) {
        let kind = self.param(m, 0, 0.0);
        match OpenCylinder::of_parameter(kind) {
            Some(cylinder) => {
                self.finish_cylinder(m);
                let polygons = self.polygon_count();
                self.open_cylinder(OpenCylinder { marks_steps: true, polygons, ..cylinder }, m);
            }
            None => self.open_polygon(),
        }
    }

    /// Whether `}` and `.` belong to the spline of this bracket level rather than to a polygon.
    pub(super) fn is_in_spline(&self) -> bool {
        self.cylinder().is_some_and(|c| c.marks_steps && c.polygons == self.polygon_count())
    }

    /// Adds the end of a step to the spline of this bracket level, if one is unfinished.
    pub(super) fn step_point(&mut self) {
        if self.is_in_spline() {
            self.cylinder_point(STRIPS);
        }
    }

    /// `@bo`, `@bc`: places a ring as thick as the line, facing +Z or in the turtle's plane.
    fn ring(&mut self, c: char, m: Module<'_>) {
        let width = self.s.width / self.s.scale.max(1e-300);
        let d = self.param(m, 0, width) * self.s.scale * self.options.unit_m;
        if d <= 0.0 {
            return;
        }
        let tube = (self.s.width * self.options.unit_m / d).clamp(1e-3, 0.5);
        let material = self.shape_material(false);
        let q = if c == 'o' { DQuat::IDENTITY } else { self.s.frame.quat() };
        match self.shape_prototypes.ring(&mut self.builder.protos, material, tube) {
            Some(proto) => {
                let pose = TurtlePose { p: self.s.p, q };
                self.place_organ(pose, ProtoRange::single(proto), OrganSize { scale: d, petiole: 0.0 }, m);
            }
            None => self.too_many_prototypes(c),
        }
    }

    /// `@PD(id,s,t)`: draws a patch with s times t quads.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before the cast")]
    fn draw_patch(&mut self, m: Module<'_>) {
        let id = self.param(m, 0, 0.0);
        let quads = [1, 2].map(|i| self.param(m, i, 8.0).clamp(1.0, MAX_QUADS) as u32);
        let Some(patch) = self.patches.get(&number(id)) else { return self.unknown_patch(id) };
        // Bezier form of all rows, then of all columns; coordinates become relative to the first point of the patch.
        let rows = patch.points.map(|row| patch.basis.bezier(row));
        let columns = [0, 1, 2, 3].map(|j| patch.basis.bezier([0, 1, 2, 3].map(|i| rows[i][j])));
        let origin = columns[0][0];
        let size = columns.iter().flatten().fold(0.0_f64, |s, p| s.max((*p - origin).abs().max_element()));
        if size < 1e-9 || !size.is_finite() {
            return;
        }
        let points = [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| ((columns[j][i] - origin) / size).to_array()));
        let surface = SurfaceFile {
            contact: [0.0; 3],
            end: [0.0; 3],
            heading: [0.0, 1.0, 0.0],
            up: [0.0, 0.0, -1.0],
            size: 1.0,
            patches: vec![SurfacePatch { color: None, points }],
        };
        let mut mesh = super::patches::patch_mesh(&surface, quads, None);
        let material = self.shape_material(true);
        mesh.subsets.iter_mut().for_each(|s| s.material = material);
        let pose = TurtlePose { p: origin, q: DQuat::IDENTITY };
        match self.shape_prototypes.surface(&mut self.builder.protos, "patch", mesh) {
            Some(proto) => {
                self.place_organ(pose, ProtoRange::single(proto), OrganSize { scale: size, petiole: 0.0 }, m)
            }
            None => self.too_many_prototypes('@'),
        }
    }

    /// `@Tx(id)`: sets the texture of what is drawn from here on; 0 removes it, an unknown number is warned of (L048).
    pub(super) fn set_texture(&mut self, m: Module<'_>) {
        let id = number(self.param(m, 0, 0.0));
        self.rare.texture = self.options.textures.get(&id).copied();
        if id != 0 && self.rare.texture.is_none() {
            let message = format!("texture {id} is unknown");
            self.warn("L048", (Some('@'), 'T'), message, "name its picture in the view: texture: F: file.png");
        }
    }

    /// Material of polygons, discs and open contours (`thin`), and of spheres and closed contours.
    pub(super) fn shape_material(&self, thin: bool) -> MaterialId {
        let painted = self.worn_color().map(|index| Paint { index, thin }.material());
        self.rare.texture.or(painted).unwrap_or(self.options.shape_material)
    }
}

/// The parameter of a command as a whole number; negative values become 0.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
fn number(value: f64) -> u32 {
    value as u32
}
