// A planner in C++: keep to the path, slow down where it is narrow.
//
//     c++ -O2 -std=c++17 -ffp-contract=off examples/external/cpp/follow.cpp -o follow
//     hlsd bench --planner exec:./follow --worlds 0:300:30
//
// The same arithmetic as in ../python/follow.py, operation by operation; without
// -ffp-contract=off some compilers join a product and a sum, which rounds otherwise.

#include "hlsd_external.hpp"

#include <algorithm>
#include <cmath>
#include <string>

struct Follow {
  double period_s = 0.05;
  double top_speed = 0;
  std::size_t first = 0, last = 0;

  // Notes how fast to drive, and which beams point ahead: 45 degrees of them.
  void reset(const hlsd::Setup& setup) {
    top_speed = std::min(0.5, setup.limits.max_speed);
    const std::int64_t middle = setup.lidar.beams / 2, half = setup.lidar.beams / 12;
    first = static_cast<std::size_t>(middle - half);
    last = static_cast<std::size_t>(middle + half);
  }

  // Turns towards the local goal; drives as fast as the room ahead allows.
  hlsd::Command plan(const hlsd::Observation& observation) {
    const hlsd::Point goal = observation.local_goal_in_base;
    const auto begin = observation.ranges_m.begin();
    const double clearance = *std::min_element(begin + static_cast<std::ptrdiff_t>(first),
                                               begin + static_cast<std::ptrdiff_t>(last));
    const double bearing = std::atan2(goal.y, goal.x);
    double speed = top_speed * clearance / (clearance + 0.3);
    if (std::fabs(bearing) > 0.8) speed = 0.0;
    return {speed, std::min(std::max(2.0 * bearing, -1.5), 1.5)};
  }
};

int main(int count, char** words) {
  hlsd::Options options;
  options.scan_float64 = count > 1 && std::string(words[1]) == "float64";
  Follow follow;
  return hlsd::serve(follow, options);
}
