// Fields and time steps: the field menu and the time bar of the page. Datasets without them have neither.
//
//   1  the state's `selection` says what is shown; without one, the last step of the first field
//   2  the menu and the bar write it, and are drawn from it
//   3  playing asks for the next step when the one before is on the screen: a slow server is never flooded
//
// Steps have numbers, which never change; the slider counts the steps that are served of the field.
// @ts-check

import { axisNamesOf } from './isoscope-view.js';
import { toHex } from './values.js';
import { fieldToWord, quantityFromJson } from './view-state.js';

/** @typedef {import('./isoscope-view.js').FrameRequest} FrameRequest */
/** @typedef {{number: number, value: number}} Step */
/** @typedef {{word: string, label: string, field: any, component: any}} Choice */

/** At most so many steps a second are played. */
const STEPS_PER_SECOND = 10;

/**
 * Returns the scalars that surfaces are drawn of, in the dataset's order: each component of each field.
 * @param {any} dataset @returns {Choice[]}
 */
export function choicesOf(dataset) {
  return (dataset?.fields ?? []).flatMap((/** @type {any} */ field) => (field.components ?? []).map(
    (/** @type {any} */ component) => {
      const word = fieldToWord({ field: field.name, component: component.name });
      const name = field.longName || field.name;
      const unit = field.unit ? ` (${field.unit})` : '';
      return { word, label: `${name}${component.name ? ` ${component.name}` : ''}${unit}`, field, component };
    }));
}

/**
 * Returns the choice that a selection means; null if the dataset has no fields, or not this one.
 * @param {any} dataset @param {any} selection @returns {Choice | null}
 */
export function choiceOf(dataset, selection) {
  const name = selection?.field || dataset?.fields?.[0]?.name;
  const components = choicesOf(dataset).filter(({ field }) => field.name === name);
  // The last one of several is the magnitude.
  return (selection?.component ? components.find(({ component }) => component.name === selection.component)
    : components.at(-1)) ?? null;
}

/**
 * The steps that are served of a field, by time.
 * @param {any} dataset @param {any} field @returns {Step[]}
 */
export function stepsOf(dataset, field) {
  const steps = (dataset?.timeSteps ?? []).map((/** @type {any} */ { number = 0, value = 0 }) => ({ number, value: Number(value) }));
  return field ? (field.timeSteps ?? []).map((/** @type {number} */ at) => steps[at]).filter(Boolean) : steps;
}

/**
 * The place of a selection among steps: of its number, or nearest to its time, of two the earlier; else the last.
 * @param {Step[]} steps @param {any} selection @returns {number} -1 if there is no such step
 */
export function indexOfStep(steps, selection) {
  const { timeStep, time } = selection ?? {};
  if (timeStep != null && timeStep >= 0) {
    return steps.findIndex(({ number }) => number === timeStep);
  }
  if (time == null || timeStep != null) {
    return steps.length - 1;
  }
  return steps.reduce((best, step, i) => best < 0 || Math.abs(step.value - time) < Math.abs(steps[best].value - time) ? i : best, -1);
}

/**
 * The words of a histogram's address for what a selection means; '' without fields.
 * @param {any} dataset @param {any} selection
 */
export function histogramWords(dataset, selection) {
  const choice = choiceOf(dataset, selection);
  if (!choice) {
    return '';
  }
  const steps = stepsOf(dataset, choice.field);
  const step = steps[indexOfStep(steps, selection)];
  return `&${new URLSearchParams({ field: choice.field.name, ...(choice.component.name ? { component: choice.component.name } : {}),
    ...(step ? { step: String(step.number) } : {}) })}`;
}

/**
 * The range of the samples that a histogram has counted, to the width of its bins, within the range of all steps.
 * @param {any} histogram a GetHistogramResponse @param {{min: number, max: number} | null} whole
 * @returns {{min: number, max: number} | null} null if no samples were counted
 */
export function rangeOfBins({ bins = [], hasSampleCounts = false }, whole) {
  const filled = hasSampleCounts ? bins.filter((/** @type {any} */ { sampleCount = 0 }) => Number(sampleCount) > 0) : [];
  return filled.length === 0 ? null : { min: Math.max(Number(filled[0].min ?? 0), whole?.min ?? -Infinity),
    max: Math.min(Number(filled.at(-1).max ?? 0), whole?.max ?? Infinity) };
}

/**
 * Whether each field of a dataset is served at the step that a selection means, so that a pick can have all values.
 * @param {any} dataset @param {any} selection
 */
export function hasAllFields(dataset, selection) {
  const choice = choiceOf(dataset, selection);
  const steps = choice ? stepsOf(dataset, choice.field) : [];
  const step = steps[indexOfStep(steps, selection)];
  return choice !== null && (steps.length === 0 || (step !== undefined &&
    dataset.fields.every((/** @type {any} */ field) => stepsOf(dataset, field).some(({ number }) => number === step.number))));
}

/**
 * The values of all fields at a picked point, as names and texts with units.
 * @param {any} point of the response @param {any} dataset @param {(value: number) => string} format
 * @returns {{name: string, text: string}[]}
 */
export function valuesOf(point, dataset, format) {
  return (point.fieldValues ?? []).map((/** @type {any} */ { field, component = '', unit = '', value = 0 }) => {
    const { longName } = (dataset?.fields ?? []).find((/** @type {any} */ one) => one.name === field) ?? {};
    const number = Number(value);  // a text if it is not finite
    return { name: `${longName || field} ${component}`.trim(), text: Number.isNaN(number) ? 'no value' : `${format(number)} ${unit}`.trim() };
  });
}

/**
 * Takes out of a state what needs fields or steps that the dataset does not have. Returns a sentence for each.
 * @param {FrameRequest} state @param {any} dataset @returns {string[]}
 */
export function withoutFields(state, dataset) {
  /** @type {string[]} */
  const problems = [];
  if ((dataset.fields ?? []).length > 0) {
    return problems;
  }
  if (state.selection) {
    problems.push('Field and time of this link were left out: the dataset has one field and one step.');
    delete state.selection;
  }
  for (const surface of state.surfaces ?? []) {
    if (surface.colorBy?.quantity === 'QUANTITY_FIELD') {
      problems.push(`color-by=${fieldToWord(surface.colorBy)} of this link was left out: it is x, y, z, normal, gradient ` +
        'or none, for the dataset has no other fields.');
      delete surface.colorBy;
    }
  }
  return problems;
}

/** Goes from step to step; what is shown says when the next one may come. */
export class Player {
  /**
   * @param {{next: () => number | null, stopped: () => void}} how next: asks for another step and returns its number, or
   *   null at the end
   * @param {(action: () => void, ms: number) => any} [later] @param {() => number} [now] milliseconds
   */
  constructor(how, later = (action, ms) => setTimeout(action, ms), now = () => performance.now()) {
    this.how = how;
    this.later = later;
    this.now = now;
    this.isPlaying = false;
    /** The step that was asked for. @type {number | null} */
    this.awaited = null;
    this.askedAt = 0;
    this.run = 0;
  }

  start() {
    if (!this.isPlaying) {
      this.isPlaying = true;
      this.run += 1;
      this.#next(this.run);
    }
  }

  stop() {
    if (this.isPlaying) {
      this.isPlaying = false;
      this.awaited = null;
      this.how.stopped();
    }
  }

  /** @param {number} step that is on the screen */
  shown(step) {
    if (this.isPlaying && step === this.awaited) {
      this.awaited = null;
      const { run } = this;
      this.later(() => this.#next(run), Math.max(0, 1000 / STEPS_PER_SECOND - (this.now() - this.askedAt)));
    }
  }

  /** @param {number} run which a stop has ended */
  #next(run) {
    if (!this.isPlaying || run !== this.run) {
      return;
    }
    this.askedAt = this.now();
    this.awaited = this.how.next();
    if (this.awaited === null) {
      this.stop();
    }
  }
}

/**
 * @typedef {object} SeriesElements
 * @property {HTMLSelectElement} field @property {HTMLElement} fieldPicker
 * @property {HTMLElement} timeline @property {HTMLButtonElement} back @property {HTMLButtonElement} play
 * @property {HTMLButtonElement} on @property {HTMLInputElement} step @property {HTMLElement} time
 * @property {HTMLInputElement} loop @property {HTMLElement} quantities the options of fields that colour
 */

/** The field menu and the time bar. */
export class SeriesControls {
  /**
   * @param {import('./isoscope-view.js').View} view @param {SeriesElements} elements
   * @param {{chooseField: (selection: any) => void, say: (sentence: string) => void, format: (value: number) => string}} how
   *   chooseField: shows a field for whose samples no isovalue was chosen yet
   */
  constructor(view, elements, how) {
    this.view = view;
    this.elements = elements;
    this.how = how;
    /** What the picture on the screen is of; null before the first one. @type {any} */
    this.shownSelection = null;
    this.drawnMenu = '';
    /** Whether the next step that is played is the first one. */
    this.begins = false;
    this.player = new Player({ next: () => this.#playNext(), stopped: () => {
      this.draw();
      view.update({});
    } });
    this.#listen();
  }

  /** What the state means. @returns {Choice | null} */
  get choice() {
    return choiceOf(this.view.dataset, this.view.state.selection);
  }

  get steps() {
    return stepsOf(this.view.dataset, this.choice?.field);
  }

  /** The scalar and the step that the state means, as one word. */
  get stepKey() {
    const { steps } = this;
    return `${this.choice?.word ?? ''}@${steps[indexOfStep(steps, this.view.state.selection)]?.number ?? ''}`;
  }

  get isPlaying() {
    return this.player.isPlaying;
  }

  /**
   * The state with the step that is on the screen: for links, picks and downloads, as the last step may be another
   * one soon.
   * @param {FrameRequest} state @returns {FrameRequest}
   */
  pinned(state) {
    const { shownSelection, view } = this;
    const isOfState = shownSelection && view.isCurrent;
    return isOfState && (state.selection?.timeStep ?? -1) < 0 ? { ...state, selection: { ...shownSelection } } : state;
  }

  /**
   * Takes what a new picture is of.
   * @param {any} frame of the response
   */
  frameShown(frame) {
    this.shownSelection = frame?.selection ?? null;
    if (this.shownSelection) {
      this.player.shown(this.shownSelection.timeStep ?? 0);
    }
  }

  /**
   * A dataset that grows has new steps. Without a step in the state, the newest one is shown.
   * @param {any} dataset
   */
  refresh(dataset) {
    const { view } = this;
    if (!dataset || dataset.name !== view.dataset?.name || JSON.stringify(dataset) === JSON.stringify(view.dataset)) {
      return;
    }
    const before = this.steps.at(-1)?.number;
    view.dataset = dataset;
    this.draw();
    const { timeStep, time } = view.state.selection ?? {};
    if (this.steps.at(-1)?.number !== before && (timeStep ?? -1) < 0 && time === undefined && !this.isPlaying) {
      view.renew();
    }
  }

  draw() {
    const { dataset } = this.view;
    const { elements, choice, steps } = this;
    const choices = choicesOf(dataset);
    const menu = JSON.stringify(choices.map(({ word, label }) => [word, label]));
    if (menu !== this.drawnMenu) {
      this.drawnMenu = menu;
      const options = (/** @type {string} */ prefix) => choices.map(({ word, label }) => {
        const option = document.createElement('option');
        option.value = `${prefix}${word}`;
        option.textContent = label;
        return option;
      });
      elements.field.replaceChildren(...options(''));
      elements.quantities.replaceChildren(...options('field:'));
    }
    elements.fieldPicker.hidden = choices.length === 0;
    elements.quantities.hidden = choices.length === 0;
    elements.field.value = choice?.word ?? '';
    elements.timeline.hidden = steps.length < 2;
    const at = indexOfStep(steps, this.view.state.selection);
    const text = this.#textOf(steps, at);
    elements.step.max = String(Math.max(0, steps.length - 1));
    elements.step.value = String(Math.max(0, at));
    elements.step.setAttribute('aria-valuetext', text);
    const [value, ...which] = text.split(' · ');
    const rest = document.createElement('span');
    rest.className = 'which';
    rest.textContent = which.map((word) => ` · ${word}`).join('');
    elements.time.replaceChildren(value, rest);
    elements.back.disabled = at <= 0;
    elements.on.disabled = at >= steps.length - 1;
    const name = this.isPlaying ? 'Pause' : 'Play';
    elements.play.title = `${name} (Space)`;
    elements.play.setAttribute('aria-label', name);
    elements.play.classList.toggle('playing', this.isPlaying);
  }

  /** @param {Step[]} steps @param {number} at */
  #textOf(steps, at) {
    const step = steps[at];
    const unit = this.view.dataset?.timeUnit;
    return step ? `${this.how.format(step.value)}${unit ? ` ${unit}` : ''} · step ${step.number} (${at + 1} of ${steps.length})`
      : 'no such step';
  }

  /** @param {number} at among the steps @param {boolean} isMoving */
  #show(at, isMoving) {
    const step = this.steps[at];
    if (step) {
      const { time, ...rest } = this.view.state.selection ?? {};
      this.view.update({ selection: { ...rest, timeStep: step.number } }, { isMoving });
    }
  }

  /** @returns {number | null} */
  #playNext() {
    const { steps } = this;
    const at = this.begins ? 0 : indexOfStep(steps, this.view.state.selection) + 1;
    this.begins = false;
    const next = at < steps.length ? at : this.elements.loop.checked ? 0 : null;
    if (next === null || steps.length < 2) {
      return null;
    }
    this.#show(next, true);
    return steps[next].number;
  }

  /** Plays, at the last step from the first one on, or rests. */
  toggle() {
    if (this.isPlaying) {
      this.player.stop();
      return;
    }
    const { steps } = this;
    this.begins = indexOfStep(steps, this.view.state.selection) >= steps.length - 1;
    this.player.start();
    this.draw();
  }

  /** Ends a play. */
  rest() {
    this.player.stop();
  }

  /** @param {number} delta */
  step(delta) {
    this.player.stop();
    const at = indexOfStep(this.steps, this.view.state.selection) + delta;
    if (at >= 0 && at < this.steps.length) {
      this.#show(at, false);
    }
  }

  #listen() {
    const { elements, view } = this;
    elements.field.onchange = () => {
      const choice = choicesOf(view.dataset).find(({ word }) => word === elements.field.value);
      if (!choice) {
        return;
      }
      this.player.stop();
      const { component, ...rest } = view.state.selection ?? {};
      this.how.chooseField({ ...rest, field: choice.field.name, ...(choice.component.name ? { component: choice.component.name } : {}) });
    };
    elements.back.onclick = () => this.step(-1);
    elements.on.onclick = () => this.step(1);
    elements.play.onclick = () => this.toggle();
    elements.step.oninput = () => {
      this.player.stop();
      this.#show(elements.step.valueAsNumber, true);
    };
    elements.step.onchange = () => this.how.say(this.#textOf(this.steps, indexOfStep(this.steps, view.state.selection)));
    document.addEventListener('keydown', (event) => this.#key(event));
    view.addEventListener('notice', (event) => {
      if (/** @type {CustomEvent} */ (event).detail.isError) {
        this.player.stop();
      }
    });
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const target = /** @type {Element} */ (event.target);
    // Where keys have a meaning of their own.
    if (event.metaKey || event.ctrlKey !== event.altKey || this.elements.timeline.hidden ||
        target.closest('input, select, textarea, button, a, dialog, [role=slider]')) {
      return;
    }
    if (event.key === '[' || event.key === ']') {
      this.step(event.key === '[' ? -1 : 1);
    } else if (event.key === ' ' && !event.repeat) {
      this.toggle();
    } else {
      return;
    }
    event.preventDefault();
  }
}

/** @typedef {{title: string, colorMap: any, range: any, nan: string}} LegendEntry `nan`: "" where the picture has none */

/**
 * The bars of the legend: of each colouring with a map, once, and of cuts that show samples.
 * @param {any} frame of the response @param {any} dataset @returns {LegendEntry[]}
 */
export function legendOf(frame, dataset) {
  /** @type {Map<string, LegendEntry>} */
  const entries = new Map();
  for (const { colorBy, nanColor, showsNan } of frame?.colorings ?? []) {
    if (colorBy?.range) {
      const key = JSON.stringify(colorBy);
      const nan = showsNan ? toHex(nanColor) : '';
      entries.set(key, { title: titleOfColoring(colorBy, dataset), colorMap: colorBy.colorMap, range: colorBy.range,
        nan: nan || (entries.get(key)?.nan ?? '') });
    }
  }
  const { caps, nanColor, showsNan } = frame?.capsColoring ?? {};
  if (caps?.range) {
    const title = choiceOf(dataset, frame.selection)?.label ?? 'samples';
    entries.set('caps', { title: `${title} on cuts`, colorMap: caps.colorMap, range: caps.range, nan: showsNan ? toHex(nanColor) : '' });
  }
  return [...entries.values()];
}

/**
 * The name of a colouring's quantity, for the legend.
 * @param {any} colorBy @param {any} dataset
 */
export function titleOfColoring(colorBy, dataset) {
  if (colorBy.quantity === 'QUANTITY_FIELD') {
    return choiceOf(dataset, colorBy)?.label ?? fieldToWord(colorBy);
  }
  const quantity = quantityFromJson(colorBy.quantity);
  return quantity === 'gradient' ? quantity : `position ${axisNamesOf(dataset)['xyz'.indexOf(quantity)]}`;
}
