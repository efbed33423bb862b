//! What leaves hang on, as rain sees it.

use std::any::Any;

use glam::{DQuat, DVec3};

use osier_base::Result;

/// Where a leaf is and how it moves, in the world. Its mesh is rigid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blade {
    /// Its pivot, m.
    pub p: DVec3,
    /// World from leaf space.
    pub q: DQuat,
    /// Velocity of its pivot, m/s.
    pub v: DVec3,
    /// rad/s.
    pub spin: DVec3,
    /// Acceleration of its pivot over the last step, m/s^2.
    pub a: DVec3,
    /// Angular acceleration over the last step, rad/s^2.
    pub whirl: DVec3,
}

impl Blade {
    /// A leaf that does not move.
    pub fn still(p: DVec3, q: DQuat) -> Self {
        Self { p, q, v: DVec3::ZERO, spin: DVec3::ZERO, a: DVec3::ZERO, whirl: DVec3::ZERO }
    }

    /// A place of leaf space in the world, m. `scale`: of the leaf.
    pub fn world(&self, local: DVec3, scale: f64) -> DVec3 {
        self.p + self.q * (local * scale)
    }

    /// Velocity at a place of the world, m/s.
    pub fn speed_at(&self, place: DVec3) -> DVec3 {
        self.v + self.spin.cross(place - self.p)
    }

    /// Acceleration at a place of the world, m/s^2.
    pub fn acceleration_at(&self, place: DVec3) -> DVec3 {
        let arm = place - self.p;
        self.a + self.whirl.cross(arm) + self.spin.cross(self.spin.cross(arm))
    }
}

/// A piece of wood: a round cone between two places of the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bough {
    /// Ends, m.
    pub ends: [DVec3; 2],
    /// Their radii, m.
    pub radii: [f64; 2],
}

/// A plant that bears leaves: it is struck, loaded and moves. Everything in the world's space and SI units.
pub trait Bearer: Send + std::fmt::Debug {
    /// Number of its leaves; they keep their order.
    fn leaves(&self) -> usize;

    /// Where a leaf is now.
    fn blade(&self, leaf: usize) -> Blade;

    /// What a blow of 1 N s along unit vector `along` at a place of a leaf changes in the velocity of that place along it,
    /// 1/kg: b^T M^-1 b. 0 for what does not give way.
    fn lightness(&self, leaf: usize, place: DVec3, along: DVec3) -> f64;

    /// A blow, N s, on a place of a leaf; it acts during the next step.
    fn strike(&mut self, leaf: usize, place: DVec3, blow: DVec3);

    /// A force, N, on a place of a leaf during the next step.
    fn press(&mut self, leaf: usize, place: DVec3, force: DVec3);

    /// Water that lies on a leaf: kg, and its middle in the world. It weighs on the leaf and goes along with it, until it is
    /// said anew; [`Bearer::press`] is for what differs from that.
    fn load(&mut self, leaf: usize, mass: f64, middle: DVec3);

    /// Pieces of wood where they are now; their number and order stay.
    fn boughs(&self, out: &mut Vec<Bough>);

    /// What a blow does to the velocity of a piece of wood at a share (0 to 1) of its length, 1/kg.
    fn bough_lightness(&self, bough: usize, share: f64, along: DVec3) -> f64;

    /// A blow, N s, on a piece of wood; it acts during the next step.
    fn strike_bough(&mut self, bough: usize, share: f64, blow: DVec3);

    /// Velocity of a piece of wood, m/s.
    fn bough_speed(&self, bough: usize, share: f64) -> DVec3;

    /// Lets `h` seconds pass, from time `t` on, s.
    /// # Errors
    /// `Simulation` for what flies apart.
    fn step(&mut self, t: f64, h: f64) -> Result<()>;

    /// Itself, for those who know what it is and want to show it.
    fn as_any(&self) -> &dyn Any;
}

/// A plant that nothing moves.
#[derive(Debug, Clone)]
pub struct Stiff {
    blades: Vec<Blade>,
    boughs: Vec<Bough>,
}

impl Stiff {
    /// Leaves and wood where they stand in the world.
    pub fn new(leaves: &[(DVec3, DQuat)], boughs: Vec<Bough>) -> Self {
        Self { blades: leaves.iter().map(|(p, q)| Blade::still(*p, *q)).collect(), boughs }
    }
}

impl Bearer for Stiff {
    fn leaves(&self) -> usize {
        self.blades.len()
    }

    fn blade(&self, leaf: usize) -> Blade {
        self.blades[leaf]
    }

    fn lightness(&self, _: usize, _: DVec3, _: DVec3) -> f64 {
        0.0
    }

    fn strike(&mut self, _: usize, _: DVec3, _: DVec3) {}

    fn press(&mut self, _: usize, _: DVec3, _: DVec3) {}

    fn load(&mut self, _: usize, _: f64, _: DVec3) {}

    fn boughs(&self, out: &mut Vec<Bough>) {
        out.clear();
        out.extend_from_slice(&self.boughs);
    }

    fn bough_lightness(&self, _: usize, _: f64, _: DVec3) -> f64 {
        0.0
    }

    fn strike_bough(&mut self, _: usize, _: f64, _: DVec3) {}

    fn bough_speed(&self, _: usize, _: f64) -> DVec3 {
        DVec3::ZERO
    }

    fn step(&mut self, _: f64, _: f64) -> Result<()> {
        Ok(())
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}
