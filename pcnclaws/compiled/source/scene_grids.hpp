// How the particles are cut into tasks, and the part of each scene's grid that exists.
//
// Only the window of the grid that the particles touch exists. The particles are cut into tasks that scatter to windows
// of their own, which are then summed in a fixed order: the result does not depend on the number of threads.
#pragma once
#include <utility>
#include <vector>

#include "exchange.hpp"
#include "parallel.hpp"

namespace pcnclaws {

constexpr int64_t PART = 1024;  // particles of a task, more in large scenes
constexpr int64_t MOST_PARTS = 32;
constexpr size_t MOST_NODES = 8;  // nodes of the parts of a scene for each of its particles, its window not counted

// Some particles of one scene, the nodes they touch, and where these begin in the memory of the tasks.
struct Part {
    int64_t first, last, scene;
    Box box;
    size_t memory;
};

// Whether the scenes of the particles are numbers from 0 in increasing order.
template <class T> bool in_order(const Bodies<T>& bodies) {
    const int64_t n = bodies.particles;
    return n == 0 || (bodies.scene[0] >= 0 && bodies.scene[n - 1] < bodies.scenes &&
                      std::is_sorted(bodies.scene, bodies.scene + n));
}

template <class S> struct SceneGrids {
    typedef typename Plain<S>::type T;
    std::vector<Part> parts;
    std::vector<std::pair<int64_t, int64_t>> parts_of;  // of each scene, [first, last)
    std::vector<Box> boxes;                             // of each scene
    std::vector<size_t> node_memory;                    // where the nodes of each scene begin
    std::vector<std::pair<int64_t, int>> slabs;         // (scene, x)
    size_t task_nodes = 0, scene_nodes = 0;

    // shared: every scene has the whole grid of the settings, its tasks their windows
    SceneGrids(const Settings& settings, const Bodies<T>& bodies, const Field<S>& position, int threads, bool shared) {
        cut(bodies);
        parallel_for(int64_t(fine.size()), threads,
                     [&](int64_t k) { fine[k].box = box_of(settings, bodies, position, fine[k]); });
        for (int64_t scene = 0; scene < bodies.scenes; scene++) place(scene, shared ? &settings.grid : nullptr);
    }

  private:
    std::vector<Part> fine;  // before any are joined
    std::vector<std::pair<int64_t, int64_t>> fine_of;

    void cut(const Bodies<T>& bodies) {
        const int64_t* end = bodies.scene + bodies.particles;
        for (int64_t scene = 0; scene < bodies.scenes; scene++) {
            const int64_t first = std::lower_bound(bodies.scene, end, scene) - bodies.scene;
            const int64_t last = std::upper_bound(bodies.scene + first, end, scene) - bodies.scene;
            int64_t size = std::max(PART, (last - first + MOST_PARTS - 1) / MOST_PARTS);
            size = (size + LANE - 1) / LANE * LANE;
            const int64_t begin = int64_t(fine.size());
            for (int64_t from = first; from < last; from += size)
                fine.push_back({from, std::min(from + size, last), scene, empty_box(), 0});
            fine_of.push_back({begin, int64_t(fine.size())});
        }
    }

    // Parts whose windows overlap too much, because the particles are in no order, become one.
    void join_parts(int64_t scene) {
        const int64_t begin = int64_t(parts.size());
        parts.insert(parts.end(), fine.begin() + fine_of[scene].first, fine.begin() + fine_of[scene].second);
        Box all = empty_box();
        int64_t particles = 0;
        for (auto part = parts.begin() + begin; part != parts.end(); ++part) {
            join(all, part->box);
            particles += part->last - part->first;
        }
        const auto memory = [&] {
            size_t sum = 0;
            for (auto part = parts.begin() + begin; part != parts.end(); ++part) sum += part->box.size();
            return sum;
        };
        while (int64_t(parts.size()) > begin + 1 && memory() > MOST_NODES * size_t(particles) + all.size()) {
            int64_t kept = begin;
            for (int64_t k = begin; k < int64_t(parts.size()); k += 2) {
                parts[kept] = parts[k];
                if (k + 1 < int64_t(parts.size())) {
                    parts[kept].last = parts[k + 1].last;
                    join(parts[kept].box, parts[k + 1].box);
                }
                kept++;
            }
            parts.resize(size_t(kept));
        }
        parts_of.push_back({begin, int64_t(parts.size())});
    }

    void place(int64_t scene, const Box* whole) {
        join_parts(scene);
        Box box = empty_box();
        for (int64_t k = parts_of[scene].first; k < parts_of[scene].second; k++) {
            join(box, parts[k].box);
            parts[k].memory = task_nodes;
            task_nodes += parts[k].box.size();
        }
        if (whole) box = *whole;
        boxes.push_back(box);
        node_memory.push_back(scene_nodes);
        if (parts_of[scene].first == parts_of[scene].second && !whole) return;
        scene_nodes += box.size();
        for (int x = box.low[0]; x <= box.high[0]; x++) slabs.push_back({scene, x});
    }

    static Box box_of(const Settings& settings, const Bodies<T>& bodies, const Field<S>& position, const Part& part) {
        if (!settings.window) return settings.grid;
        Box box = empty_box();
        for (int axis = 0; axis < 3; axis++) {
            T low = std::numeric_limits<T>::max(), high = std::numeric_limits<T>::lowest();
            bool known = true;
            const T origin = T(settings.origin[axis]), scale = T(settings.per_metre);
            const T first = T(settings.grid.low[axis] + 1), last = T(settings.grid.high[axis] - 1);
            for (int64_t p = part.first; p < part.last; p++) {
                const T x = value_of(position.get(axis * bodies.particles + p));
                low = x < low ? x : low;
                high = x > high ? x : high;
                known &= x == x;
            }
            box.low[axis] = (known ? middle_node((low - origin) * scale, first, last) : int(first)) - 1;
            box.high[axis] = middle_node((high - origin) * scale, first, last) + 1;
            if (box.high[axis] < box.low[axis] + 2) box.high[axis] = box.low[axis] + 2;
        }
        return box;
    }
};

}  // namespace pcnclaws
