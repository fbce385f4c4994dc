// The page draws a view as the server describes it, and requests other views. The address is the
// view, and the history of the browser undoes and redoes changes.
"use strict"
const PATIENCE_MS = 300  // after this time old results are dimmed
const get = (id) => document.getElementById(id)
const film = get("film")
let view = null  // the server's description of the view
let picture = null  // the last one with an image
let depth = 0, deepest = 0  // views before this one, and before the last one
let zoomed = false

function add(parent, name, attributes = {}, text = "") {
  const space = parent.namespaceURI
  const node = parent.appendChild(document.createElementNS(space, name))
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value)
  node.textContent = text
  return node
}

async function request(path, parameters) {
  try {
    return await (await fetch(`${path}?${new URLSearchParams(parameters)}`)).json()
  } catch {
    get("refused").textContent = "The server does not answer: start `pvdf-fem explore` again."
    throw new Error("no answer")
  }
}

// ---- views

let turn = Promise.resolve()
function change(text) {
  turn = turn.then(async () => {
    const next = await request("view", {at: view.query, change: text})
    if (next.query !== view.query) {
      deepest = ++depth
      history.pushState(depth, "", next.query ? `?${next.query}` : location.pathname)
    }
    show(next)
  })
}

async function arrive() {
  depth = history.state ?? 0
  deepest = Math.max(depth, deepest)
  show(await request("view", {at: location.search.slice(1)}))
}

function show(next) {
  view = next
  get("refused").textContent = view.refused.join("\n")
  if (!view.refused.length) get("any").reset()
  get("name").textContent = document.title = view.name
  get("undo").disabled = depth === 0
  get("redo").disabled = depth === deepest
  get("link").href = `?${view.query}`
  get("save").href = `scene.toml?${new URLSearchParams({at: view.query})}`
  get("save").download = view.name
  draw()
  showControls()
  solve()
}

// One view at a time is solved; if the view has changed meanwhile, then the newest.
let solving = false, solved = null
async function solve() {
  if (solving || solved === view.query) return
  solving = true
  try {
    while (solved !== view.query) {
      const at = view.query
      const late = setTimeout(() => document.body.classList.add("stale"), PATIENCE_MS)
      get("ellipses").replaceChildren()
      const results = await request("picture", {at})
      clearTimeout(late)
      solved = at
      if (at !== view.query) continue
      showResults(results)
      get("certainty").replaceChildren()
      if (!results.image || !view.probes.length) continue
      const certainty = await request("certainty", {at})
      if (at === view.query) showCertainty(certainty)
    }
  } finally {
    solving = false
  }
}

// ---- the film

function draw() {
  const points = view.electrodes.concat(view.probes).flatMap((shape) => shape.points.flat())
  const reach = view.reach
  const half = zoomed ? 1.2 * Math.max(...points.map(Math.abs), 0.05 * reach) : 1.02 * reach
  const pixel = 2.3 * half / (film.clientWidth || 600)  // in mm, on the screen
  const margin = 34 * pixel
  film.setAttribute("viewBox", [-half - margin, -half, 2 * half + margin, 2 * half + 2 * margin].join(" "))
  for (const rim of [get("rim"), film.querySelector("clipPath polygon")]) rim.setAttribute("points", svgPoints(view.rim))
  drawAxes(half, pixel)
  drawElectrodes(pixel)
  drawProbes(pixel)
}

function svgPoints(points) {
  return points.map(([x, y]) => `${x},${-y}`).join(" ")
}

function outline(parent, points, look) {
  return add(parent, "polygon", {points: svgPoints(points), "vector-effect": "non-scaling-stroke", ...look})
}

function label(parent, x, y, text, size, look = {}) {
  const middle = {"text-anchor": "middle", "dominant-baseline": "central", "pointer-events": "none"}
  return add(parent, "text", {x, y, "font-size": size, ...middle, ...look}, text)
}

function drawAxes(half, pixel) {
  const axes = get("axes")
  axes.replaceChildren()
  const power = 10 ** Math.floor(Math.log10(half / 2))
  const step = [1, 2, 5, 10].map((n) => n * power).find((s) => half / s <= 4)
  for (let n = -Math.floor(half / step); n <= half / step; n++) {
    const text = `${+(n * step).toPrecision(6)}`
    label(axes, n * step, half + 12 * pixel, text, 11 * pixel, {fill: "#555"})
    label(axes, -half - 12 * pixel, -n * step, text, 11 * pixel, {fill: "#555"})
  }
  label(axes, -half - 12 * pixel, half + 12 * pixel, "mm", 11 * pixel, {fill: "#555"})
  if (!picture) return
  const {label: title, low, high, colours} = picture
  const scale = add(axes, "linearGradient", {id: "scale"})
  colours.forEach((c, i) => add(scale, "stop", {offset: i / (colours.length - 1), "stop-color": c}))
  const y = half + 34 * pixel, width = 0.8 * half
  const box = {x: -width, y, width, height: 12 * pixel, fill: "url(#scale)", stroke: "#999"}
  add(axes, "rect", {...box, "stroke-width": pixel})
  const ends = {"text-anchor": "end"}, start = {"text-anchor": "start"}
  label(axes, -width - 6 * pixel, y + 6 * pixel, low, 12 * pixel, ends)
  label(axes, 6 * pixel, y + 6 * pixel, `${high}  ${title}`, 12 * pixel, start)
}

function drawElectrodes(pixel) {
  const layer = get("electrodes")
  layer.replaceChildren()
  for (const {name, colour, points, x, y} of view.electrodes) {
    outline(layer, points, {fill: colour, stroke: "#fff", "stroke-width": 1})
    const halo = {"paint-order": "stroke", stroke: colour, "stroke-width": 3 * pixel}
    label(layer, x, -y, name, 12 * pixel, {...halo, fill: "#fff", "font-weight": 600})
  }
}

function drawProbes(pixel) {
  const layer = get("probes")
  layer.replaceChildren()
  for (const probe of view.probes) {
    const group = add(layer, "g", {"data-probe": probe.key})
    const grip = {"stroke-width": 22, stroke: "transparent", fill: "transparent"}  // for fingers
    const bodies = [grip, {"stroke-width": 2, stroke: "#111", fill: "#111", "fill-opacity": 0.12}]
    for (const look of bodies) {
      outline(group, probe.points, look).onpointerdown = (down) => drag(down, probe, group, false)
    }
    if (!probe.can_turn) continue
    const angle = (probe.rotation + 90) * Math.PI / 180, far = probe.handle_distance + 8 * pixel
    const at = {cx: probe.x + far * Math.cos(angle), cy: -probe.y - far * Math.sin(angle)}
    const look = {fill: "#fff", stroke: "#111", "stroke-width": 2 * pixel}
    const knob = add(group, "circle", {...at, r: 7 * pixel, ...look, class: "knob"})
    knob.onpointerdown = (down) => drag(down, probe, group, true)
  }
}

// Moves or turns a probe with the pointer; where it is dropped goes to the server.
function drag(down, probe, group, turns) {
  const place = (event) => {
    const {x, y} = new DOMPoint(event.clientX, event.clientY).matrixTransform(film.getScreenCTM().inverse())
    return [x, -y]
  }
  const from = place(down), {key, x, y} = probe
  let text = ""
  const move = (event) => {
    const to = place(event), dx = to[0] - from[0], dy = to[1] - from[1]
    const angle = (point) => Math.atan2(point[1] - y, point[0] - x) * 180 / Math.PI
    const turned = angle(to) - angle(from)
    group.setAttribute("transform", turns ? `rotate(${-turned} ${x} ${-y})` : `translate(${dx} ${-dy})`)
    const rotation = (probe.rotation + turned + 540) % 360 - 180
    text = turns ? `${key}.rotation_deg=${rotation.toFixed(2)}`
      : `${key}.x_mm=${(x + dx).toFixed(4)} ${key}.y_mm=${(y + dy).toFixed(4)}`
  }
  down.preventDefault()
  get("ellipses").replaceChildren()
  film.setPointerCapture(down.pointerId)
  film.onpointermove = move
  film.onpointerup = film.onpointercancel = () => {
    film.onpointermove = film.onpointerup = film.onpointercancel = null
    if (text) change(text)
  }
}

// ---- results

function showResults(results) {
  const setText = (id, texts) => { get(id).textContent = texts.join("\n") }
  if (results.failed) {
    setText("unsolved", [`No solution: ${results.failed}`])
    document.body.classList.add("stale")
    return
  }
  document.body.classList.remove("stale")
  picture = results.image
  if (picture) {
    const reach = view.reach
    const box = {href: picture.url, x: -reach, y: -reach, width: 2 * reach, height: 2 * reach}
    for (const [key, value] of Object.entries(box)) get("field").setAttribute(key, value)
  }
  get("field").style.display = picture ? "" : "none"
  draw()
  setText("unsolved", results.reason ? [`No solution: ${results.reason}`] : [])
  setText("warnings", results.warnings)
  get("numbers").innerHTML = results.numbers
  get("bars").replaceChildren()
  for (const {name, title, rows} of results.bars.filter((bars) => bars.rows.length)) {
    add(get("bars"), "h2", {}, title)
    const grid = add(get("bars"), "div", {class: "bars", id: name})
    for (const row of rows) {
      const bar = add(grid, "div", {class: "bar", "data-value": row.value})
      add(bar, "b", {style: `color: ${row.colour}`, title: row.name}, row.name)
      const look = `left: ${row.from}%; width: ${row.width}%; background: ${row.colour}`
      add(add(bar, "span"), "i", {style: look})
      add(bar, "em", {}, row.text)
    }
  }
}

function showCertainty({failed, message, table, ellipses}) {
  const panel = get("certainty")
  panel.replaceChildren()
  add(panel, "h2", {}, "locating this touch")
  add(panel, "p", {}, failed ?? message)
  if (table) add(panel, "div").innerHTML = table
  for (const points of ellipses ?? []) {
    outline(get("ellipses"), points, {fill: "#c0f", "fill-opacity": 0.25, stroke: "#c0f", "stroke-width": 2})
  }
}

// ---- controls

let shownKeys = ""
function showControls() {
  const all = Object.values(view.controls).flat()
  const keys = all.map((control) => control.key + ("min" in control)).join()
  if (keys !== shownKeys) {
    shownKeys = keys
    get("controls").replaceChildren()
    for (const [table, controls] of Object.entries(view.controls)) {
      const group = add(get("controls"), "details", table === "film" ? {} : {open: ""})
      add(group, "summary", {}, table)
      for (const control of controls) addControl(group, control)
    }
  }
  for (const control of all) {
    const [input, slider] = document.querySelectorAll(`[data-key="${control.key}"]`)
    const limits = {min: control.min, max: control.max, step: control.step}
    if (slider) Object.assign(slider, limits)
    for (const one of slider ? [input, slider] : [input]) one.value = control.value ?? ""
  }
}

function addControl(group, {key, title, meaning, choices, min}) {
  const box = add(group, "div", {class: "control"})
  const name = add(box, "label", {for: key}, title)
  const text = add(group, "p", {class: "meaning", hidden: ""}, `${key}: ${meaning}`)
  name.onclick = () => { text.hidden = !text.hidden }
  const look = {id: key, "data-key": key}
  const send = (event) => change(`${key}=${event.target.value}`)
  if (choices) {
    const select = add(box, "select", {...look, class: "wide"})
    add(select, "option", {value: "", disabled: ""}, "none of these")
    for (const word of choices) add(select, "option", {}, word)
    select.onchange = send
  } else if (min === undefined) {
    add(box, "input", {...look, class: "wide"}).onchange = send
  } else {
    const number = add(box, "input", {...look, type: "number", step: "any"})
    const slider = add(box, "input", {type: "range", "data-key": key, "aria-label": title})
    number.onchange = slider.onchange = send
    slider.oninput = () => { number.value = slider.value }
  }
}

get("any").onsubmit = (event) => {
  event.preventDefault()
  const field = get("any").querySelector("input")
  if (field.value.trim()) change(field.value)
}
get("undo").onclick = () => history.back()
get("redo").onclick = () => history.forward()
get("zoom").onclick = () => {
  zoomed = !zoomed
  get("zoom").textContent = zoomed ? "zoom out" : "zoom in"
  draw()
}
get("picture").onclick = () => {
  const text = new XMLSerializer().serializeToString(film)
  get("picture").href = `data:image/svg+xml,${encodeURIComponent(text)}`
}
window.onpopstate = arrive
window.onresize = () => view && draw()
arrive()
