//! What of a leaf is leaf: its picture may cut holes into the mesh, and drops that fall through them go on.

use glam::{DVec2, Vec2};

use crate::scene::{Image, Material, Mesh, Pixels};

/// Which pixels of a leaf's picture are leaf.
/// Source: [yang-wu] 4 says nothing of holes; a pixel is one where the material's `alpha_cutoff` cuts it away.
#[derive(Debug, Clone)]
pub struct Cover {
    width: usize,
    height: usize,
    /// Rows from the top.
    whole: Vec<bool>,
}

impl Cover {
    /// Of the materials that a mesh shows, the first whose picture cuts holes; none if no drop would fall through one.
    pub fn of(mesh: &Mesh, materials: &[Material], images: &[Image]) -> Option<Self> {
        mesh.subsets.iter().find_map(|s| Self::cut(materials.get(s.material as usize)?, images))
    }

    fn cut(material: &Material, images: &[Image]) -> Option<Self> {
        let image = images.get(material.maps.color? as usize).filter(|i| i.channels == 4)?;
        let (cutoff, Pixels::U8(bytes)) = (material.alpha_cutoff?, &image.pixels) else { return None };
        let whole: Vec<bool> = bytes.chunks_exact(4).map(|p| f32::from(p[3]) / 255.0 >= cutoff).collect();
        let (width, height) = (image.width as usize, image.height as usize);
        (whole.len() == width * height && whole.contains(&false)).then_some(Self { width, height, whole })
    }

    /// Whether there is leaf at texture coordinates, which repeat beyond 0 to 1.
    pub fn is_leaf(&self, uv: DVec2) -> bool {
        let place = Vec2::new(crate::math::narrow(uv.x), crate::math::narrow(1.0 - uv.y));
        let share = place - place.floor();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 up, and clamped")]
        let [x, y] = [(share.x, self.width), (share.y, self.height)].map(|(s, n)| ((s * n as f32) as usize).min(n - 1));
        self.whole[y * self.width + x]
    }
}
