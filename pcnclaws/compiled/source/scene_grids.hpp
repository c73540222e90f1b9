// How the particles are cut into tasks, and the part of each scene's grid that exists.
//
// Only the window of the grid that the particles touch exists. The particles are cut into tasks that scatter to windows
// of their own, which are then summed in a fixed order: the result does not depend on the number of threads.
#pragma once
#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "parallel.hpp"
#include "stencils.hpp"

namespace pcnclaws {

struct Settings {
    double time_step;
    int64_t nodes;               // cells along an edge of the domain
    int64_t stick;               // 1 for sticking walls, 0 for slipping ones
    int64_t window;              // 1 for the touched window of the grid, 0 for the whole grid
    const unsigned char* walls;  // of the nodes -1 .. nodes + 1 of an axis: bit 0 low wall, bit 1 high wall
};

template <class S> struct State {
    Field<S> position, velocity, affine, deformation;
};

template <class T> struct Bodies {
    int64_t particles, scenes;
    const int64_t* scene;  // scene of each particle, not decreasing
    const T *mass, *volume, *gravity;
};

constexpr int64_t PART = 1024;  // particles of a task, more in large scenes
constexpr int64_t MOST_PARTS = 32;

// Some particles of one scene, the nodes they touch, and where these begin in the memory of the tasks.
struct Part {
    int64_t first, last, scene;
    Box box;
    size_t memory;
};

template <class S> struct SceneGrids {
    typedef typename Plain<S>::type T;
    std::vector<Part> parts;
    std::vector<std::pair<int64_t, int64_t>> parts_of;  // of each scene, [first, last)
    std::vector<Box> boxes;                             // of each scene
    std::vector<size_t> node_memory;                    // where the nodes of each scene begin
    std::vector<std::pair<int64_t, int>> slabs;         // (scene, x)
    size_t task_nodes = 0, scene_nodes = 0;

    SceneGrids(const Settings& settings, const Bodies<T>& bodies, const Field<S>& position, int threads) {
        cut(bodies);
        parallel_for(int64_t(parts.size()), threads,
                     [&](int64_t k) { parts[k].box = box_of(settings, bodies, position, parts[k]); });
        for (int64_t scene = 0; scene < bodies.scenes; scene++) place(scene);
    }

  private:
    void cut(const Bodies<T>& bodies) {
        const int64_t* end = bodies.scene + bodies.particles;
        for (int64_t scene = 0; scene < bodies.scenes; scene++) {
            const int64_t first = std::lower_bound(bodies.scene, end, scene) - bodies.scene;
            const int64_t last = std::upper_bound(bodies.scene + first, end, scene) - bodies.scene;
            int64_t size = std::max(PART, (last - first + MOST_PARTS - 1) / MOST_PARTS);
            size = (size + LANE - 1) / LANE * LANE;
            const int64_t begin = int64_t(parts.size());
            for (int64_t from = first; from < last; from += size)
                parts.push_back({from, std::min(from + size, last), scene, empty_box(), 0});
            parts_of.push_back({begin, int64_t(parts.size())});
        }
    }

    void place(int64_t scene) {
        Box box = empty_box();
        for (int64_t k = parts_of[scene].first; k < parts_of[scene].second; k++) {
            join(box, parts[k].box);
            parts[k].memory = task_nodes;
            task_nodes += parts[k].box.size();
        }
        boxes.push_back(box);
        node_memory.push_back(scene_nodes);
        if (parts_of[scene].first == parts_of[scene].second) return;
        scene_nodes += box.size();
        for (int x = box.low[0]; x <= box.high[0]; x++) slabs.push_back({scene, x});
    }

    static Box box_of(const Settings& settings, const Bodies<T>& bodies, const Field<S>& position, const Part& part) {
        const int last = int(settings.nodes) + 1;
        if (!settings.window) return {{-1, -1, -1}, {last, last, last}};
        Box box = empty_box();
        for (int axis = 0; axis < 3; axis++) {
            T low = std::numeric_limits<T>::max(), high = std::numeric_limits<T>::lowest();
            bool known = true;
            for (int64_t p = part.first; p < part.last; p++) {
                const T x = value_of(position.get(axis * bodies.particles + p));
                low = x < low ? x : low;
                high = x > high ? x : high;
                known &= x == x;
            }
            const T scale = T(settings.nodes);
            box.low[axis] = (known ? middle_node(low * scale, scale) : 0) - 1;
            box.high[axis] = middle_node(high * scale, scale) + 1;
            if (box.high[axis] < box.low[axis] + 2) box.high[axis] = box.low[axis] + 2;
        }
        return box;
    }
};

}  // namespace pcnclaws
