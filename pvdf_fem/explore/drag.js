// Drags the probe under the pointer, or turns the one whose knob is under it. What is dragged is
// drawn at once; where it is dropped goes to the server in one message.
const p = probes.data
if (cb_obj.event_name == "panstart") {
    const near = (x, y, r) => Math.hypot(cb_obj.x - x, cb_obj.y - y) < r
    const knob = p.x.findIndex((_, i) => near(p.knob_x[i], p.knob_y[i], 0.2 * p.reach[i] + 0.6))
    const body = p.x.findIndex((_, i) => near(p.x[i], p.y[i], 0.9 * p.reach[i]))
    const i = knob < 0 ? body : knob
    held.from = i < 0 ? null : {i, turns: knob >= 0, x: cb_obj.x, y: cb_obj.y, was: structuredClone(p)}
}
if (!held.from) return
const {i, turns, x, y, was} = held.from, cx = was.x[i], cy = was.y[i]
const [dx, dy] = turns ? [0, 0] : [cb_obj.x - x, cb_obj.y - y]
const angle = turns ? Math.atan2(cb_obj.y - cy, cb_obj.x - cx) - Math.atan2(y - cy, x - cx) : 0
const c = Math.cos(angle), s = Math.sin(angle)
const moved_x = (a, b) => cx + dx + c * (a - cx) - s * (b - cy)
const moved_y = (a, b) => cy + dy + s * (a - cx) + c * (b - cy)
const old_xs = Array.from(was.xs[i]), old_ys = Array.from(was.ys[i])
p.xs[i] = old_xs.map((a, k) => moved_x(a, old_ys[k]))
p.ys[i] = old_ys.map((b, k) => moved_y(old_xs[k], b))
p.x[i] = cx + dx
p.y[i] = cy + dy
p.knob_x[i] = moved_x(was.knob_x[i], was.knob_y[i])
p.knob_y[i] = moved_y(was.knob_x[i], was.knob_y[i])
probes.change.emit()
if (cb_obj.event_name == "panend") {
    held.from = null
    const turned = (p.rotation_deg[i] + angle * 180 / Math.PI + 540) % 360 - 180
    const places = {x_mm: p.x[i], y_mm: p.y[i]}, changes = turns ? {rotation_deg: turned} : places
    const keys = Object.keys(changes), numbers = Object.values(changes)
    dropped.data = {key: keys.map(key => `${p.key[i]}.${key}`), value: numbers.map(v => +v.toFixed(4))}
}
