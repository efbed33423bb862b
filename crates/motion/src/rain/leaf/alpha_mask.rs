//! Holes that the alpha channel of a leaf's picture cuts into its mesh; drops fall through them.

use glam::DVec2;

use osier_scene::{Image, Material, Mesh, Pixels, pixel_at};

/// Which pixels of a leaf's picture are leaf and which are holes.
/// Source: [yang-wu] 4, whose leaves have an alpha map; a pixel is a hole where its alpha is below the material's
/// `alpha_cutoff`.
#[derive(Debug, Clone)]
pub struct AlphaMask {
    size: [u32; 2],
    /// Row by row from the top; true where the leaf is solid.
    solid: Vec<bool>,
}

#[cfg(test)]
impl AlphaMask {
    /// The mask of a leaf that is one hole.
    pub(crate) fn of_a_hole() -> Self {
        Self { size: [1, 1], solid: vec![false] }
    }
}

impl AlphaMask {
    /// The mask of the first material of a mesh whose color map has alpha and a cutoff. `None` if that map has no hole, or
    /// no material has such a map.
    pub fn of_first_mapped_material(mesh: &Mesh, materials: &[Material], images: &[Image]) -> Option<Self> {
        mesh.subsets.iter().find_map(|s| Self::from_material(materials.get(s.material as usize)?, images))
    }

    fn from_material(material: &Material, images: &[Image]) -> Option<Self> {
        let image = images.get(material.maps.color? as usize).filter(|i| i.channels == 4)?;
        let (cutoff, Pixels::U8(bytes)) = (material.alpha_cutoff?, &image.pixels) else { return None };
        let solid: Vec<bool> = bytes.chunks_exact(4).map(|p| f32::from(p[3]) / 255.0 >= cutoff).collect();
        let size = [image.width, image.height];
        let complete = solid.len() == image.width as usize * image.height as usize;
        (complete && solid.contains(&false)).then_some(Self { size, solid })
    }

    /// Whether the leaf is solid at texture coordinates, which repeat beyond 0 to 1.
    pub fn is_solid(&self, uv: DVec2) -> bool {
        self.solid[pixel_at(uv.as_vec2(), self.size)]
    }
}
