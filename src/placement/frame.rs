//! What is drawn for an eye and a gaze: faces, and the image that stands for the rest.

use super::cells::Cells;
use super::count::Boxes;
use super::frustum::Field;
use super::gaze::Compass;
use super::prove::Marked;
use super::sweep::Sweep;
use glam::DVec3;
use std::ops::Range;
use std::sync::Arc;

/// A scene in cells with the images of a plan.
pub struct Plan {
    pub cells: Arc<Cells>,
    pub boxes: Arc<Boxes>,
    pub compass: Compass,
    pub field: Field,
    pub budget: u32,
    /// Those placed for eyes in the domain, then the shell's, each of which has the whole scene behind it.
    pub images: Vec<Marked>,
    pub shell: usize,
}

/// An eye's answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// All that is seen fits.
    Bare,
    /// The rest is behind this image.
    Image(usize),
    /// No image fits; what is seen is too much.
    Nothing,
}

impl Plan {
    /// Chooses the image of the closest viewpoint in the reverse frustum that keeps the budget, of those of one viewpoint
    /// the one that is aimed best; collects what is left as ranges of [`Cells::order`].
    pub fn frame(&self, eye: DVec3, yaw: f64, pitch: f64, faces: &mut Vec<Range<u32>>) -> Answer {
        let sweep = Sweep::one(eye, yaw, pitch, &self.compass, self.field);
        if self.boxes.count(&sweep, None, self.budget) <= self.budget {
            self.collect(&sweep, None, faces);
            return Answer::Bare;
        }
        let forward = self.compass.forward(yaw, pitch);
        let mut fit: Vec<_> = self.images[..self.images.len() - self.shell]
            .iter()
            .enumerate()
            .filter(|(_, m)| m.image.is_beyond(&sweep.eyes) && sweep.starts_at(m.image.viewpoint))
            .map(|(index, m)| (m.image.viewpoint.distance_squared(eye), -m.image.forward.dot(forward), index))
            .collect();
        fit.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
        for (_, _, index) in fit {
            let marks = Some(&self.images[index].marks[..]);
            if self.boxes.count(&sweep, marks, self.budget) <= self.budget {
                self.collect(&sweep, marks, faces);
                return Answer::Image(index);
            }
        }
        Answer::Nothing
    }

    /// What an eye beyond the domain draws: all that it sees, or the closest image of the shell alone, if the eye is before
    /// the plane of any.
    pub fn beyond(&self, eye: DVec3, yaw: f64, pitch: f64, faces: &mut Vec<Range<u32>>) -> Answer {
        let sweep = Sweep::one(eye, yaw, pitch, &self.compass, self.field);
        if self.boxes.count(&sweep, None, self.budget) <= self.budget {
            self.collect(&sweep, None, faces);
            return Answer::Bare;
        }
        faces.clear();
        let first = self.images.len() - self.shell;
        let before = self.images[first..].iter().enumerate().filter(|(_, m)| m.image.is_beyond(&sweep.eyes));
        let away = |m: &Marked| m.image.viewpoint.distance_squared(eye);
        let closest = before.min_by(|a, b| away(a.1).total_cmp(&away(b.1)));
        closest.map_or(Answer::Nothing, |(index, _)| Answer::Image(first + index))
    }

    fn collect(&self, sweep: &Sweep, marks: Option<&[super::image::Mark]>, faces: &mut Vec<Range<u32>>) {
        let mut nodes = Vec::new();
        self.boxes.seen(sweep, marks, &mut nodes);
        faces.clear();
        let all = self.cells.nodes();
        for range in nodes {
            for node in &all[range.start as usize..range.end as usize] {
                match faces.last_mut() {
                    Some(last) if last.end == node.first => last.end = node.own_end,
                    _ => faces.push(node.first..node.own_end),
                }
            }
        }
    }
}
