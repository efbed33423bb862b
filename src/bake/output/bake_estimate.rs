//! Result of an estimate: counts, bytes of files and bytes of memory.

use osier_base::Result;
use osier_base::limits::Limits;

/// Predicted counts over all assets, and predicted bytes, of a bake or a single file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BakeEstimate {
    /// Assets, each of which has separate files in most formats.
    pub assets: u64,
    /// Placements of assets in the scene; several may show one asset.
    pub placements: u64,
    /// Modules of the final strings of all individuals; 0 if no grammar grows a plant.
    pub modules: u64,
    /// Vertices of meshes, prototypes counted once.
    pub vertices: u64,
    /// Triangles of meshes, prototypes counted once.
    pub triangles: u64,
    /// Instances of all instancers; those of an asset count once, however often it is placed.
    pub instances: u64,
    /// Points of all clouds; those of an asset count once, however often it is placed.
    pub points: u64,
    /// Joints of all skeletons; those of an asset count once, however often it is placed.
    pub joints: u64,
    /// Frames that are written; 0 for a still scene.
    pub frames: u64,
    /// Predicted bytes of all files: the sum of `sizes`.
    pub bytes: u64,
    /// Bytes by format, under its word, then those of `pictures` and `wind`.
    pub sizes: Vec<(&'static str, u64)>,
    /// Bytes of memory at the peak of the run, by purpose; parts of 0 bytes are left out.
    pub memory: Vec<(&'static str, u64)>,
}

impl BakeEstimate {
    /// Predicted peak of memory, bytes: the sum of `memory`.
    pub fn peak(&self) -> u64 {
        self.memory.iter().map(|p| p.1).sum()
    }

    /// Compares the bytes written with the limit `output-bytes`, whose default is the same on all machines.
    /// # Errors
    /// `Limit`.
    pub fn check_size(&self, limits: &Limits) -> Result<()> {
        limits.check("output-bytes", self.bytes, "the predicted size of the output, in bytes,")
    }

    /// Compares the bytes written and the peak of memory with the limits `output-bytes` and `memory`.
    /// # Errors
    /// `Limit` for the first that is exceeded.
    pub fn check_limits(&self, limits: &Limits) -> Result<()> {
        self.check_size(limits)?;
        limits.check("memory", self.peak(), "the predicted peak of memory, in bytes,")
    }
}
