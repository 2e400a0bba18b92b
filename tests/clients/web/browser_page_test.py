#!/usr/bin/env python3
"""What holds the page together, in a real browser: the door, links, undo, panels, phones, pixels, downloads.

    browser_page_test.py [unittest arguments]

Against mock_gateway.mjs, and against a real `isoscope view` where ISOSCOPE_BIN has one. Ends with 77 (skipped) where
browser_test.py does.
"""
import contextlib
import os
import shlex
import shutil
import struct
import subprocess
import tempfile
import time
import urllib.parse

import browser_test as base
from browser_test import size_of, skips

if base.webdriver is not None:
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys


class PageTest(base.PageTest):
    def until_drawn(self):
        """Waits until the controls are drawn of the dataset that is shown."""
        self.until('isoscope.view.dataset && isoscope.view.dataset.name === isoscope.view.state.dataset')
        super().until_drawn()

    def choose(self, menu, value):
        """Chooses an entry of a menu by its id, once the page has it."""
        self.until(f'[...document.getElementById("{menu}").options].some((one) => one.value === "{value}")')
        self.js("const [id, value] = arguments; const menu = document.getElementById(id); menu.value = value; menu.dispatchEvent(new Event('change'));", menu, value)

    @contextlib.contextmanager
    def held(self, addresses):
        """Answers to these addresses, a regular expression, wait until the end of it."""
        self.gateway.control(hold=addresses)
        try:
            yield
        finally:
            self.gateway.control(hold=None)

    def until_held(self, count=1):
        end = time.monotonic() + base.PATIENCE_S
        while len(self.gateway.control()['held']) < count:
            self.assertLess(time.monotonic(), end, 'nothing was asked for')
            time.sleep(0.02)


class DoorTest(PageTest):
    TOKEN = base.TokenTest.TOKEN
    IS_CLOSED = '!document.getElementById("door").hidden'

    def setUp(self):
        super().setUp()
        self.gateway.control(token=self.TOKEN)

    @contextlib.contextmanager
    def another_tab(self):
        """A tab of its own has no token of before."""
        first = self.browser.current_window_handle
        self.browser.switch_to.new_window('tab')
        try:
            yield
        finally:
            self.browser.close()
            self.browser.switch_to.window(first)

    def enter(self, text):
        field = self.browser.find_element(By.ID, 'door-token')
        field.clear()
        field.send_keys(text, Keys.ENTER)

    def test_a_link_opened_elsewhere_asks_for_the_token_once_and_then_shows_its_view(self):
        with self.another_tab():
            self.open('#dataset=ball&surface=65:1,0,0', query='?theme=dark&max-side=420')
            self.until(f'{self.IS_CLOSED} && document.getElementById("door-sentence").textContent')
            self.assertIn('needs its token', self.browser.find_element(By.ID, 'door-sentence').text)
            # No second message stays beside the door once the gateway has said why it refused the connection.
            self.until('isoscope.view.loop.connection.attempt > 0 && document.getElementById("toast").hidden && isoscope.view.stats().notice === ""')
            self.assertTrue(self.js('return document.querySelector("main").inert && document.activeElement.id === "door-token"'))
            self.enter('wrong')
            self.until('/not the token/.test(document.getElementById("door-sentence").textContent)')
            self.assertTrue(self.js(f'return {self.IS_CLOSED}'))
            self.enter(self.TOKEN)
            self.until(f'isoscope.view.isExact && !({self.IS_CLOSED})')
            self.assertEqual([65], self.js('return isoscope.view.state.surfaces.map((one) => one.isovalue)'))
            self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
            self.assertFalse(self.js('return document.querySelector("main").inert'))
            self.assertNotIn('token', self.browser.current_url)
            self.browser.refresh()
            self.until('isoscope.view.isExact')
            self.assertFalse(self.js(f'return {self.IS_CLOSED}'), 'a reload asks again')

    def test_the_door_takes_the_whole_address_that_was_printed(self):
        with self.another_tab():
            self.open(query='?theme=dark&max-side=420')
            self.until(self.IS_CLOSED)
            self.enter(f'{self.gateway.url}?token={urllib.parse.quote(self.TOKEN, safe="")}&dataset=ball')
            self.until('isoscope.view.isExact')

    def test_a_tab_of_before_a_restart_takes_the_refusal_at_once_and_asks_for_the_new_token(self):
        with self.another_tab():
            self.open_and_wait('#dataset=ball&surface=55', query=base.TokenTest.QUERY)
            self.gateway.control(token='of-the-next-start', drop=[1001, ''])
            self.until(self.IS_CLOSED)
            self.assertNotIn('Trying again', self.notice())
            attempts = 'isoscope.view.loop.connection.attempt'
            before = self.js(f'return {attempts}')
            base.time.sleep(1.5)  # the first attempts were half a second and a second apart
            self.assertEqual(before, self.js(f'return {attempts}'), 'a refused token is tried again and again')
            self.enter('of-the-next-start')
            self.until(f'isoscope.view.isExact && !({self.IS_CLOSED})')
            self.assertEqual([55], self.js('return isoscope.view.state.surfaces.map((one) => one.isovalue)'))

    def test_an_answer_to_the_token_of_before_does_not_close_the_door_again(self):
        with self.another_tab():
            self.open('#dataset=ball&surface=55', query='?theme=dark&max-side=420')
            self.until(self.IS_CLOSED)
            with self.held('^/v1/datasets$'):
                self.enter(self.TOKEN)
                self.until(f'!({self.IS_CLOSED}) && isoscope.view.loop.connection.isOpen')
                self.until_held()
                self.gateway.control(token='of-the-next-start', drop=[1001, ''])
                self.until(self.IS_CLOSED)
                self.enter('of-the-next-start')
                self.until(f'!({self.IS_CLOSED})')
            self.until('isoscope.view.isExact')
            self.assertFalse(self.js(f'return {self.IS_CLOSED}'))

    def test_a_link_with_access_opens_without_a_question_and_keeps_the_token_out_of_every_address(self):
        self.open_and_wait('#dataset=ball&surface=65', query=base.TokenTest.QUERY)
        self.js('navigator.clipboard.writeText = async (text) => { window.copied = text; };')
        self.browser.find_element(By.ID, 'link-access').click()
        self.until('window.copied')
        copied = urllib.parse.urlsplit(self.js('return window.copied'))
        self.assertNotIn('token', copied.query)
        self.assertEqual(self.TOKEN, dict(urllib.parse.parse_qsl(copied.fragment))['token'])
        self.gateway.control(reset=True)
        with self.another_tab():
            self.browser.get(copied.geturl())
            self.until('isoscope.view.isExact')
            self.assertNotIn('token', self.browser.current_url)
            self.assertEqual([65], self.js('return isoscope.view.state.surfaces.map((one) => one.isovalue)'))
            self.assertEqual('', self.js('return document.getElementById("toast").textContent'), 'the token is no wrong part of the link')
        self.assertEqual([], [one for one in self.gateway.control()['targets'] if 'token' in one])

    def test_a_link_with_access_opens_the_door_of_a_tab_that_waits_for_a_token(self):
        with self.another_tab():
            self.open('#dataset=ball&surface=55', query='?theme=dark&max-side=420')
            self.until(self.IS_CLOSED)
            self.js('location.hash = arguments[0]', f'#dataset=ball&surface=65&token={urllib.parse.quote(self.TOKEN, safe="")}')
            self.until(f'isoscope.view.isExact && !({self.IS_CLOSED})')
            self.assertEqual([65], self.js('return isoscope.view.state.surfaces.map((one) => one.isovalue)'))
            self.assertNotIn('token', self.browser.current_url)
            self.assertEqual(4, self.js('return document.getElementById("dataset").options.length'), 'only the dataset of the link is listed')

    def test_the_door_stands_before_an_open_dialog(self):
        with self.another_tab():
            self.open_and_wait('#dataset=ball&surface=55', query=base.TokenTest.QUERY)
            self.browser.find_element(By.ID, 'save').click()
            self.until('document.getElementById("dialog").open')
            self.gateway.control(token='of-the-next-start', drop=[1001, ''])
            self.until(f'{self.IS_CLOSED} && !document.getElementById("dialog").open')
            self.enter('of-the-next-start')
            self.until(f'isoscope.view.isExact && !({self.IS_CLOSED})')

    def test_without_a_token_there_is_no_link_with_access(self):
        self.gateway.control(token=None)
        with self.another_tab():
            self.open_and_wait(query='?theme=dark&max-side=420')
            self.assertTrue(self.js('return document.getElementById("link-access").hidden'))


class ChoiceTest(PageTest):
    def test_a_wrong_dataset_of_a_link_offers_those_that_there_are(self):
        self.open('#dataset=gone&surface=1')
        self.until('!document.getElementById("choice").hidden')
        choice = self.browser.find_element(By.ID, 'choice')
        self.assertIn('There is no dataset “gone” here.', choice.text)
        self.assertEqual(['ball', 'patient', 'flow', 'organs'], [one.text for one in choice.find_elements(By.TAG_NAME, 'button')])
        choice.find_element(By.CSS_SELECTOR, '[title=patient]').click()
        self.until('isoscope.view.isExact && document.getElementById("choice").hidden')
        state = self.js('return isoscope.view.getState()')
        # An isovalue of other samples is not kept.
        self.assertEqual(('patient', 40), (state['dataset'], state['surfaces'][0]['isovalue']))

    def test_the_same_volume_under_another_name_keeps_the_view_of_the_link(self):
        self.open('#dataset=Ball-0123456789abcdef&surface=65')
        self.until('!document.getElementById("choice").hidden')
        self.browser.find_element(By.CSS_SELECTOR, '#choice [title=ball]').click()
        self.until('isoscope.view.isExact && isoscope.view.state.dataset === "ball"')
        self.assertEqual(65, self.js('return isoscope.view.state.surfaces[0].isovalue'))


class UndoTest(PageTest):
    # Whether the buttons of undo and redo can be pressed.
    BUTTONS = '[...document.querySelectorAll("#undo, #redo")].map((button) => !button.disabled).join()'

    def press(self, *keys):
        actions = base.ActionChains(self.browser)
        for key in keys[:-1]:
            actions = actions.key_down(key)
        actions = actions.send_keys(keys[-1])
        for key in keys[:-1]:
            actions = actions.key_up(key)
        actions.perform()

    def until_eye(self, eye):
        self.until(f'isoscope.view.isExact && Math.hypot(...isoscope.view.camera.eye.map((v, i) => v - {eye}[i])) < 1e-9')

    def test_a_drag_is_one_entry_and_keys_and_buttons_go_back_and_forth(self):
        self.open_and_wait()
        first, eye = self.picture(), self.js('return isoscope.view.camera.eye')
        self.until_kept()
        self.assertEqual('false,false', self.js(f'return {self.BUTTONS}'))
        self.drag(120, 40, steps=12)
        self.until(f'{self.BUTTONS} === "true,false"')
        turned = self.js('return isoscope.view.camera.eye')
        self.press(Keys.CONTROL, 'z')
        self.until_eye(eye)
        self.assertEqual('false,true', self.js(f'return {self.BUTTONS}'), 'a drag is more than one entry')
        self.assertEqual(1, self.share_of_equal(self.picture(), first))
        self.press(Keys.CONTROL, Keys.SHIFT, 'z')
        self.until_eye(turned)
        self.browser.find_element(By.ID, 'undo').click()
        self.until_eye(eye)
        self.press(Keys.CONTROL, 'y')
        self.until_eye(turned)

    def test_settings_come_back_and_a_new_change_ends_the_way_forward(self):
        self.open_and_wait()
        self.until_kept()
        for isovalue in (60, 70):
            self.js('isoscope.view.update({ surfaces: [{ isovalue: arguments[0] }] })', isovalue)
            self.until_kept()
        self.browser.find_element(By.ID, 'undo').click()
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[0].isovalue === 60')
        self.until('document.querySelector("#surfaces input[type=number]").value === "60"')
        self.choose('samples', '16')
        self.until(f'{self.BUTTONS} === "true,false"')
        self.browser.find_element(By.ID, 'undo').click()
        self.until('isoscope.view.isExact && isoscope.view.state.samples === 4')

    def test_undo_goes_back_to_the_dataset_before(self):
        self.open_and_wait('#dataset=ball&surface=55')
        self.until_kept()
        self.choose('dataset', 'patient')
        self.until(f'isoscope.view.isExact && isoscope.view.state.dataset === "patient" && {self.BUTTONS} === "true,false"')
        self.browser.find_element(By.ID, 'undo').click()
        self.until('isoscope.view.isExact && isoscope.view.state.dataset === "ball" && document.getElementById("dataset").value === "ball"')
        self.assertEqual(55, self.js('return isoscope.view.state.surfaces[0].isovalue'))


class LateTest(PageTest):
    """Answers that come late, while the view goes on."""
    SURFACES = 'isoscope.view.state.surfaces.map((one) => one.isovalue).join()'
    EYE = 'isoscope.view.camera.eye'

    def test_the_legend_names_the_axes_of_a_dataset_that_comes_after_the_picture(self):
        with self.held('^/v1/datasets/patient$'):
            self.open('#dataset=patient&surface=40&color-by=z:viridis')
            self.until('isoscope.view.isExact && !document.getElementById("legend").hidden && !isoscope.view.dataset')
        self.until('/position S/.test(document.getElementById("legend").textContent)')

    def test_a_view_that_people_turn_before_the_page_is_whole_stays_turned(self):
        self.open_and_wait('#dataset=ball&surface=40:1,0,0')
        self.until('/eye=/.test(location.hash)')
        link = self.js('return location.hash')
        self.addCleanup(lambda: self.gateway.control(broken=None))
        self.gateway.control(broken='^/v1/datasets$|/histogram[?]')
        self.open(link)
        self.until_exact()
        self.until('document.getElementById("toast").textContent')  # with the next connection the datasets are asked for again
        self.gateway.control(broken=None)
        with self.held('/histogram'):
            self.gateway.control(drop=[1001, ''])
            self.until_held()
            self.until_exact()
            before = self.js(f'return {self.EYE}')
            self.drag(120, 40)
            turned = self.js(f'return {self.EYE}')
            self.assertNotEqual(before, turned)
        self.until('isoscope.view.state.withNotes && isoscope.view.isExact')
        self.assertEqual(turned, self.js(f'return {self.EYE}'))

    def test_a_view_that_people_turn_while_another_field_comes_stays_turned(self):
        self.open_and_wait('#dataset=flow&surface=40&step=1')
        with self.held('/histogram'):
            self.choose('field', 'velocity:x')
            self.until_held()
            before = self.js(f'return {self.EYE}')
            self.drag(120, 40)
            turned = self.js(f'return {self.EYE}')
            self.assertNotEqual(before, turned)
        self.until('isoscope.view.isExact && isoscope.view.state.selection.field === "velocity"')
        self.assertEqual(turned, self.js(f'return {self.EYE}'))

    def test_undo_pressed_twice_while_the_dataset_before_comes_goes_back_twice(self):
        self.open_and_wait('#dataset=ball&surface=55')
        self.until_kept()
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 60 }] })')
        self.until_kept()
        self.choose('dataset', 'patient')
        self.until('isoscope.view.isExact && isoscope.view.state.dataset === "patient"')
        self.until_kept()
        with self.held('^/v1/datasets/ball/histogram'):
            self.js('for (const time of [1, 2]) document.getElementById("undo").click()')
            self.until_held()
        self.until(f'isoscope.view.isExact && isoscope.view.state.dataset === "ball" && {self.SURFACES} === "55"')
        self.assertTrue(self.js('return document.getElementById("undo").disabled && !document.getElementById("redo").disabled'))

    def test_undo_ends_the_way_to_another_dataset(self):
        self.open_and_wait('#dataset=ball&surface=55')
        self.until_kept()
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 60 }] })')
        self.until_kept()
        with self.held('^/v1/datasets/patient/histogram'):
            self.choose('dataset', 'patient')
            self.until_held()
            self.js('document.getElementById("undo").click()')
        self.until(f'isoscope.view.isExact && {self.SURFACES} === "55"')
        self.assertEqual(['ball', '55'], self.until_still(lambda: self.js(f'return [document.getElementById("dataset").value, {self.SURFACES}]')))

    def test_a_page_that_is_drawn_while_another_dataset_comes_does_not_ask_for_the_counts_before(self):
        self.open_and_wait('#dataset=ball&surface=40')
        with self.held('/histogram'):
            self.choose('dataset', 'organs')
            self.until_held()
            # The counts of another step are asked for after 250 ms of rest.
            self.js('window.isLater = false; window.dispatchEvent(new Event("resize")); setTimeout(() => { window.isLater = true; }, 600)')
            self.until('isLater')
            self.assertEqual(1, len(self.gateway.control()['held']))
        self.until('isoscope.view.isExact && isoscope.view.state.dataset === "organs"')
        self.assertEqual([[1], [2], [3]], self.js('return isoscope.view.state.surfaces.map(({ labels }) => labels)'))

    def test_a_point_of_the_dataset_before_is_not_added(self):
        self.open_and_wait('#dataset=ball&surface=40')
        with self.held('/pick$'):
            self.click(self.browser.find_element(By.ID, 'view'), 10, 10)
            self.until_held()
            self.choose('dataset', 'patient')
            self.until('isoscope.view.isExact && isoscope.view.state.dataset === "patient"')
        self.assertEqual(0, self.until_still(lambda: self.js('return isoscope.view.loop.overlay.pins.length')))
        self.assertGreaterEqual(self.gateway.control()['picks'], 1)

    def test_colours_take_the_range_of_the_step_though_the_dataset_has_grown_meanwhile(self):
        self.open_and_wait('#dataset=flow&surface=40&step=1&color-by=velocity:x:viridis')
        self.until('document.getElementById("range-step").offsetHeight > 0')
        with self.held('/histogram.bins=4096'):
            self.js('document.getElementById("range-step").click()')
            self.until_held()
            self.gateway.control(steps=7)
            self.until('isoscope.view.dataset.timeSteps.length === 7')
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[0].colorBy.range?.max === 50')

    def test_a_range_of_values_that_colour_no_more_is_not_taken(self):
        self.gateway.control(features=['notes', 'color_ranges'])
        self.open_and_wait('#dataset=ball&surface=40&color-by=z:viridis')
        self.until('document.getElementById("range-visible").offsetHeight > 0')
        with self.held('/render$'):
            self.js('document.getElementById("range-visible").click()')
            self.until_held()
            self.choose('quantity', 'x')
        self.until('isoscope.view.isExact && !document.getElementById("range-visible").disabled')
        self.assertEqual(['QUANTITY_POSITION_X', None],
                         self.js('const { quantity, range } = isoscope.view.state.surfaces[0].colorBy; return [quantity, range ?? null]'))

    def test_notes_of_surfaces_before_are_not_said_of_those_of_now(self):
        self.gateway.control(note='so says the server')
        self.open_and_wait()
        # The exact picture of 50 comes when 60 is asked for.
        self.js("""const { view } = isoscope; const { frames } = view.loop; const receive = frames.receive.bind(frames);
            frames.receive = (message) => {
              if (message.header?.isExact && window.told === undefined) {
                window.told = [];
                view.addEventListener('frame', () => told.push(document.getElementById('notes').textContent));
                view.update({ surfaces: [{ isovalue: 60 }] });
              }
              receive(message); };
            view.update({ surfaces: [{ isovalue: 50 }] });""")
        self.until('window.told?.includes("so says the server") && isoscope.view.isExact')
        self.assertEqual('', self.js('return told[0]'))


class HelpTest(PageTest):
    def test_the_key_and_the_button_show_moves_keys_and_the_version(self):
        self.open_and_wait()
        self.js('isoscope.view.root.focus()')
        base.ActionChains(self.browser).send_keys('?').perform()
        self.until('document.getElementById("help").open')
        text = self.browser.find_element(By.ID, 'help').text
        for word in ('Mouse', 'Touch', 'Keys', 'two fingers', 'Ctrl-Z', 'Isoscope 1.2.3'):
            self.assertIn(word.lower(), text.lower())
        base.ActionChains(self.browser).send_keys(Keys.ESCAPE).perform()
        self.until('!document.getElementById("help").open')
        self.browser.find_element(By.ID, 'help-open').click()
        self.until('document.getElementById("help").open')

    def test_in_a_field_the_key_is_a_character(self):
        self.open_and_wait('#dataset=organs&label=1')
        self.until('!document.getElementById("labels").hidden')
        self.browser.find_element(By.ID, 'label-set').send_keys('?')
        self.assertFalse(self.js('return document.getElementById("help").open'))


class NameTest(PageTest):
    def test_axes_are_those_of_the_patient_wherever_they_are_named(self):
        self.open_and_wait('#dataset=patient&surface=40&color-by=z:viridis')
        self.until('document.querySelector("#clip [aria-valuetext]") && !document.getElementById("legend").hidden')
        self.assertEqual(['position L', 'position P', 'position S'],
                         self.js('return ["x", "y", "z"].map((one) => document.querySelector(`#quantity option[value=${one}]`).textContent)'))
        self.assertIn('position S', self.browser.find_element(By.ID, 'legend').text)
        self.assertEqual(['L', 'P', 'S'], self.clip_names())
        self.open_and_wait('#dataset=ball&surface=40')
        self.until('document.querySelector("#quantity option[value=z]").textContent === "position z"')
        self.assertEqual(['x', 'y', 'z'], self.clip_names())

    def clip_names(self):
        return self.js('return [...document.querySelectorAll("#clip .double > span:first-child")].map((one) => one.textContent)')

    def test_surfaces_are_told_apart_by_colour(self):
        self.open_and_wait()
        self.browser.find_element(By.ID, 'add').click()
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces.length === 2')
        self.assertEqual(['#ded1be', '#56b4e9'], self.colors())
        self.open_and_wait('#dataset=ball&isovalue=30,60,80')
        self.until('document.querySelectorAll("#surfaces li").length === 3')
        self.assertEqual(['#ded1be', '#56b4e9', '#d55e00'], self.colors())

    def colors(self):
        return self.js('return [...document.querySelectorAll("#surfaces input[type=color]")].map((one) => one.value)')

    def test_the_two_opacities_of_a_colour_map_have_labels_of_their_own(self):
        self.open_and_wait('#dataset=ball&surface=40&color-by=z:viridis::0.5,1')
        self.until('document.querySelector("[for=opacity-min]").offsetHeight > 0')
        rows = self.js('return ["min", "max"].map((end) => document.getElementById(`opacity-${end}`).parentElement.textContent.trim())')
        self.assertEqual(['Opacity, low50 %', 'Opacity, high100 %'], rows)


class NoteTest(PageTest):
    def test_an_isovalue_beyond_the_samples_says_so_at_once_with_their_range(self):
        # Also by a server that tells no reasons.
        self.gateway.control(features=None)
        self.open_and_wait('#dataset=ball&surface=400')
        notes = 'document.getElementById("notes")'
        self.until(f'{notes}.textContent === "Isovalue 400 has no surface: the samples are from 0 to 100."')
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 40 }] })')
        self.until(f'isoscope.view.isExact && {notes}.hidden')
        self.open_and_wait('#dataset=flow&surface=-5&field=velocity:x')
        self.until(f'{notes}.textContent === "Isovalue -5 has no surface: the samples are from -2 to 50 m/s."')

    def test_what_the_page_says_by_itself_is_not_said_again_by_the_server(self):
        self.gateway.control(note='isovalue 400 has no surface: so says the server')
        self.open_and_wait('#dataset=ball&surface=400')
        self.until('/^Isovalue 400 has no surface/.test(document.getElementById("notes").textContent)')
        self.assertNotIn('so says the server', self.browser.find_element(By.ID, 'notes').text)


class ChosenLabelTest(PageTest):
    def show(self, dataset):
        self.choose('dataset', dataset)
        self.until(f'isoscope.view.isExact && isoscope.view.state.dataset === "{dataset}" && isoscope.view.dataset?.name === "{dataset}"')

    def test_a_chosen_label_is_forgotten_with_its_dataset(self):
        self.open_and_wait('#dataset=organs&label=1')
        self.until('document.querySelector("#label-list button.name")')
        self.browser.find_element(By.CSS_SELECTOR, '#label-list button.name').click()
        self.until('!document.getElementById("label-actions").hidden')
        self.show('ball')
        self.until('document.getElementById("labels").hidden')
        self.show('organs')
        self.until('!document.getElementById("labels").hidden')
        self.assertTrue(self.js('return document.getElementById("label-actions").hidden'))


class PointTest(PageTest):
    def pick(self, x, y):
        count = self.js('return isoscope.view.loop.overlay.pins.length')
        view = self.browser.find_element(By.ID, 'view')
        self.click(view, x, y)
        self.until(f'isoscope.view.loop.overlay.pins.length === {min(2, count + 1)}')

    def stale(self):
        return self.js('return isoscope.view.loop.overlay.pins.map((pin) => Boolean(pin.isStale))')

    def test_points_of_another_isovalue_fade_and_come_back_with_it(self):
        self.open_and_wait('#dataset=ball&surface=40')
        self.pick(10, 10)
        self.assertEqual([False], self.stale())
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 60 }] })')
        self.until('isoscope.view.loop.overlay.pins[0].isStale && isoscope.view.isExact')
        self.assertEqual(1, len(self.browser.find_elements(By.CSS_SELECTOR, '#points .stale')))
        pixel = base.ControlTest.PIXEL
        self.until(f'{pixel}(10, 10)[3] > 0 && {pixel}(10, 10)[3] < 200')
        self.pick(-20, 15)
        self.assertEqual([True, False], self.stale())
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 40 }] })')
        self.until('!isoscope.view.loop.overlay.pins[0].isStale')
        self.assertEqual([False, True], self.stale())

    def test_points_of_another_step_fade(self):
        self.open_and_wait('#dataset=flow&surface=40&step=1')
        self.until('document.getElementById("step").max === "5"')
        self.pick(5, 5)
        self.browser.find_element(By.ID, 'step-on').click()
        self.until('isoscope.view.loop.overlay.pins[0].isStale')

    def test_the_panel_has_units_and_names_of_axes_and_no_numbers_of_blocks(self):
        self.open_and_wait('#dataset=patient&surface=40')
        self.pick(10, 10)
        text = self.browser.find_element(By.ID, 'points').text
        self.assertRegex(text, r'L, P, S\s+[-0-9.,]+, [-0-9.,]+, [-0-9.,]+ mm')
        for word in ('block', 'shard'):
            self.assertNotIn(word, text)
        self.open_and_wait('#dataset=flow&surface=40&step=3')
        self.pick(0, 0)
        self.assertRegex(self.browser.find_element(By.ID, 'points').text, r'value\s+40 Pa')

    def test_points_are_copied_as_a_table_with_all_digits(self):
        self.open_and_wait('#dataset=patient&surface=40')
        self.pick(10, 10)
        self.pick(-40, 20)
        self.js('navigator.clipboard.writeText = async (text) => { window.copied = text; };')
        self.browser.find_element(By.ID, 'points-copy').click()
        self.until('window.copied')
        titles, a, b = [line.split(',') for line in self.js('return window.copied').splitlines()]
        self.assertEqual(['point', 'L (mm)', 'P (mm)', 'S (mm)', 'value', 'normal L', 'normal P', 'normal S'], titles)
        pins = self.js('return isoscope.view.loop.overlay.pins.map((pin) => pin.position)')
        for name, row, position in (('A', a, pins[0]), ('B', b, pins[1])):
            self.assertEqual((name, '40'), (row[0], row[4]))
            self.assertEqual(position, [float(cell) for cell in row[1:4]])

    def test_the_panel_is_moved_by_a_drag_and_by_keys_and_stays_within_the_picture(self):
        self.open_and_wait('#dataset=ball&surface=40')
        self.pick(10, 10)
        panel, handle = self.browser.find_element(By.ID, 'points'), self.browser.find_element(By.ID, 'points-handle')
        before, grip = panel.rect, 15 - handle.size['width'] // 2
        base.ActionChains(self.browser, duration=10).move_to_element_with_offset(handle, grip, 0).click_and_hold().move_by_offset(150, 90).release().perform()
        moved = panel.rect
        self.assertEqual((before['x'] + 150, before['y'] + 90), (moved['x'], moved['y']))
        handle.send_keys(Keys.ARROW_LEFT)
        self.assertEqual(moved['x'] - 16, panel.rect['x'])
        place = handle.rect  # the pointer stays in the window, and would take the panel beyond the picture
        to_corner = (1 - int(place['x']) - int(place['width']) // 2 - grip, 1 - int(place['y']) - int(place['height']) // 2)
        base.ActionChains(self.browser, duration=10).move_to_element_with_offset(handle, grip, 0).click_and_hold().move_by_offset(*to_corner).release().perform()
        stage = self.browser.find_element(By.ID, 'stage').rect
        self.assertEqual((stage['x'], stage['y']), (panel.rect['x'], panel.rect['y']))
        self.assertEqual(1, len(self.js('return isoscope.view.loop.overlay.pins')), 'a drag of the panel picks')


class SentenceTest(PageTest):
    # The toast shows again, as it may have ended before the picture is there.
    BOXES = '''document.getElementById('toast').hidden = false; const box = (element) => { const { left, top, right, bottom } = element.getBoundingClientRect(); return [left, top, right, bottom]; };
        return [document.getElementById('timeline'), document.getElementById('toast'), isoscope.view.loop.elements.notice].map(box);'''

    @staticmethod
    def overlap(a, b):
        return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]

    def test_sentences_leave_the_time_bar_free_at_every_size(self):
        for width, height in ((1440, 900), (900, 700), (390, 844)):
            with self.subTest(f'{width} x {height}'), size_of(self.browser, width, height):
                self.open('#dataset=flow&surface=40&step=1&nonsense=1')
                self.until('document.getElementById("toast").textContent && !document.getElementById("timeline").hidden')
                self.js("isoscope.view.loop.notices.problem('The server says something of a usual length, which takes more than a line.')")
                bar, toast, notice = self.js(self.BOXES)
                self.assertGreater(toast[3], toast[1])
                self.assertFalse(self.overlap(bar, toast), f'{bar} and the toast {toast}')
                self.assertFalse(self.overlap(bar, notice), f'{bar} and the notice {notice}')


class PhoneTest(PageTest):
    def test_a_phone_has_fit_and_views_and_targets_for_fingers(self):
        with size_of(self.browser, 390, 844, is_touch=True):
            self.open_and_wait('#dataset=patient&surface=40:1,0,0:0.5&surface=70&color-by=z:viridis&clip-plane=0.5,0.25,1,20')
            self.until('document.querySelector("[data-view=fit]") && document.querySelector("#clip [aria-valuetext]")')
            self.assertTrue(self.js('return matchMedia("(pointer: coarse)").matches'))
            small = self.js('''return [...document.querySelectorAll('button, select, input, .switch, .thumb')]
                .map((element) => element.closest('.switch') ?? element.closest('.slider') ?? element)
                .filter((element) => element.offsetParent !== null && !element.closest('dialog'))
                .map((element) => [element.id || element.className || element.textContent, element.getBoundingClientRect().height])
                .filter(([, height]) => height < 44)''')
            self.assertEqual([], small)
            self.assertTrue(self.js('const box = document.querySelector("[data-view=fit]").getBoundingClientRect(); return box.left >= 0 && box.right <= 390'))
            eye = self.js('return isoscope.view.camera.eye')
            self.browser.find_element(By.CSS_SELECTOR, '[data-view=anterior]').click()
            self.until(f'isoscope.view.isExact && isoscope.view.camera.eye[1] !== {eye[1]}')
            self.assertFalse(self.js('return document.documentElement.scrollWidth > 390'), 'the page is wider than the phone')

    def test_folding_the_panel_fits_the_picture_again_unless_it_was_moved(self):
        distance = '''const { eye, target } = isoscope.view.camera;
            return Math.hypot(...eye.map((value, i) => value - target[i]));'''
        direction = '''const { eye, target } = isoscope.view.camera; const d = eye.map((value, i) => value - target[i]);
            return d.map((value) => Math.round(1e6 * value / Math.hypot(...d)));'''
        with size_of(self.browser, 390, 844, is_touch=True):
            self.open_and_wait('#dataset=ball&surface=40')
            looks = self.js(direction)
            for _ in range(2):  # folded, and as before
                other = self.js(distance)
                self.browser.find_element(By.ID, 'fold').click()
                self.until(f'isoscope.view.isExact && Math.abs((() => {{ {distance} }})() - {other}) > 1e-2 * {other}')
                refitted = self.js(distance)
                self.browser.find_element(By.CSS_SELECTOR, '[data-view=fit]').click()
                self.until_exact()
                self.assertAlmostEqual(refitted, self.js(distance), delta=0.05 * refitted)  # fits are by a coarse grid of depths
                self.assertEqual(looks, self.js(direction))
            self.js('const { camera } = isoscope.view; isoscope.view.setCamera({ ...camera, up: camera.up, target: camera.target.map((x) => x + 1) })')
            self.until_exact()
            camera, tall = self.js('return [isoscope.view.camera, isoscope.view.stats().height]')
            self.browser.find_element(By.ID, 'fold').click()
            self.until(f'isoscope.view.isExact && isoscope.view.stats().height !== {tall}')
            self.assertEqual(camera, self.js('return isoscope.view.camera'))


class BarTest(PageTest):
    # The buttons and menus of the bar that show and are not wholly within the window.
    OUTSIDE = '''return [...document.querySelectorAll('.bar button, .bar select')].filter((one) => one.offsetParent !== null)
        .map((one) => [one.id || one.textContent, one.getBoundingClientRect()])
        .filter(([, box]) => box.left < 0 || box.top < 0 || box.right > innerWidth || box.bottom > innerHeight).map(([name]) => name);'''
    SIZES = ((1300, 800), (1200, 800), (1024, 768), (900, 700), (768, 1024), (844, 390), (390, 844))

    def test_no_button_of_the_bar_leaves_the_window(self):
        for dataset in ('flow', 'patient'):
            self.open_and_wait(f'#dataset={dataset}&surface=40')
            self.until('document.querySelector("[data-view=fit]")')
            for width, height in self.SIZES:
                is_touch = min(width, height) == 390
                with self.subTest(f'{dataset}, {width} x {height}'), size_of(self.browser, width, height, is_touch=is_touch):
                    self.until(f'matchMedia("(width: {width}px) and (height: {height}px)").matches && matchMedia("(pointer: coarse)").matches === {str(is_touch).lower()}')
                    self.assertEqual([], self.js(self.OUTSIDE))
                    for name in ('save', 'fold'):
                        self.assertTrue(self.browser.find_element(By.ID, name).is_displayed(), name)
                    if is_touch:
                        self.assertFalse(self.browser.find_element(By.ID, 'link').is_displayed())
                        self.browser.find_element(By.ID, 'more-open').click()
                        for name in ('link', 'theme', 'help-open', 'undo'):
                            self.assertTrue(self.browser.find_element(By.ID, name).is_displayed(), name)
                        self.assertEqual([], self.js(self.OUTSIDE))
                        self.browser.find_element(By.ID, 'more-open').click()

    def test_on_a_phone_the_menu_closes_with_a_choice_and_with_escape(self):
        with size_of(self.browser, 390, 844, is_touch=True):
            self.open_and_wait('#dataset=ball&surface=40')
            menu = self.browser.find_element(By.ID, 'more')
            self.browser.find_element(By.ID, 'more-open').click()
            self.browser.find_element(By.ID, 'theme').click()
            self.assertFalse(menu.is_displayed())
            self.browser.find_element(By.ID, 'more-open').click()
            base.ActionChains(self.browser).send_keys(Keys.ESCAPE).perform()
            self.assertFalse(menu.is_displayed())
            self.assertLessEqual(self.js('return document.querySelector(".bar").offsetHeight'), 112, 'the bar has more than two lines')

    def test_on_a_phone_the_time_bar_is_one_line_under_the_picture_and_free_of_sentences(self):
        for width, height in ((390, 844), (844, 390)):
            with self.subTest(f'{width} x {height}'), size_of(self.browser, width, height, is_touch=True):
                self.open_and_wait('#dataset=flow&surface=40&step=1')
                self.until('!document.getElementById("timeline").hidden')
                view, bar, toast = self.js('''const toast = document.getElementById('toast'); toast.hidden = false; toast.textContent = 'Copied.'; return ['view', 'timeline', 'toast'].map((id) => {
                    const { left, top, right, bottom } = document.getElementById(id).getBoundingClientRect(); return [left, top, right, bottom]; })''')
                self.assertGreaterEqual(bar[1], view[3] - 1)
                self.assertLessEqual(bar[3] - bar[1], 60)
                self.assertLessEqual(toast[3], bar[1])
                self.assertEqual([], self.js('''const within = document.getElementById('timeline').getBoundingClientRect();
                    return [...document.querySelectorAll('#timeline > *')].filter((one) => one.getBoundingClientRect().right > within.right).map((one) => one.id)'''))
                self.assertGreaterEqual(self.js('return document.getElementById("step").offsetWidth'), 40)

    def test_the_search_of_labels_looks_like_other_fields(self):
        for is_touch in (False, True):
            with self.subTest(is_touch=is_touch), size_of(self.browser, 390, 844, is_touch=is_touch):
                self.open_and_wait('#dataset=organs&label=1')
                self.until('!document.getElementById("labels").hidden')
                search, text = self.js('''document.getElementById('label-search').hidden = false; return ['label-search', 'label-set'].map((id) => {
                    const style = getComputedStyle(document.getElementById(id)); return [style.backgroundColor, style.borderRadius, style.color, style.minHeight]; })''')
                self.assertEqual(text, search)


class PixelTest(PageTest):
    QUERY = '?theme=dark'
    # The canvas of the picture, in its own pixels and in those of the device.
    CANVAS = '''const { canvas } = isoscope.view.loop.picture.screen; const box = canvas.getBoundingClientRect();
        return [canvas.width, canvas.height, Math.round(box.width * devicePixelRatio), Math.round(box.height * devicePixelRatio)];'''

    def state_text(self):
        return self.browser.find_element(By.ID, 'state').text

    def test_at_rest_the_picture_has_the_pixels_of_the_device_and_is_called_exact(self):
        for width, height, scale in ((700, 420, 1), (500, 300, 2), (430, 300, 1.5)):
            with self.subTest(f'{width} x {height} @{scale}'), size_of(self.browser, width, height, scale):
                self.open_and_wait('#dataset=ball&surface=40')
                self.until('/^exact/.test(document.getElementById("state").textContent)')
                across, down, device_across, device_down = self.js(self.CANVAS)
                # The browser snaps the edges of the element to pixels.
                self.assertLessEqual(max(abs(device_across - across), abs(device_down - down)), 1)
                self.assertEqual(f'exact · {across} × {down}', self.state_text())
                self.assertEqual('pixelated', self.js('return getComputedStyle(isoscope.view.loop.picture.screen.canvas).imageRendering'))
                self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))

    def test_a_picture_of_more_than_2048_pixels_is_drawn_where_the_server_allows_it(self):
        with size_of(self.browser, 1400, 120, 2):
            self.open_and_wait('#dataset=ball&surface=40')
            self.until('isoscope.view.stats().width > 2048')
            self.until('/^exact/.test(document.getElementById("state").textContent)')

    def test_a_picture_that_the_screen_scales_is_not_called_exact(self):
        self.gateway.control(maxViewportPx=300)
        self.open_and_wait('#dataset=ball&surface=40')
        self.until('isoscope.view.isExact && /^scaled from 300 ×/.test(document.getElementById("state").textContent)')
        self.assertEqual('auto', self.js('return getComputedStyle(isoscope.view.loop.picture.screen.canvas).imageRendering'))
        self.open_and_wait('#dataset=ball&surface=40', query='?theme=dark&max-side=420')
        self.until('/^scaled from 420 ×/.test(document.getElementById("state").textContent)')

    def test_a_server_without_memory_for_all_pixels_is_asked_for_fewer_and_for_all_once_less_is_shown(self):
        with size_of(self.browser, 1100, 700):
            self.open_and_wait('#dataset=ball&surface=40:1,0,0:0.5&surface=70')
            whole = self.js('return [isoscope.view.stats().width, isoscope.view.stats().height]')
            self.gateway.control(mostPixels=whole[0] * whole[1] * 0.6)
            self.js('isoscope.view.update({ samples: 4 })')
            self.until('isoscope.view.isExact && /^scaled from/.test(document.getElementById("state").textContent)')
            self.assertLess(self.js('return isoscope.view.stats().width'), whole[0])
            self.assertEqual('', self.notice())
            self.gateway.control(mostPixels=None)
            self.js('isoscope.view.update({ samples: undefined })')
            self.until(f'isoscope.view.isExact && isoscope.view.stats().width === {whole[0]}')
            self.until('/^exact/.test(document.getElementById("state").textContent)')


    def test_a_server_whose_queue_is_full_is_asked_again_for_all_pixels(self):
        with size_of(self.browser, 1100, 700):
            self.open_and_wait('#dataset=ball&surface=40')
            whole = self.js('return isoscope.view.stats().width')
            self.gateway.control(fail={'code': 8, 'message': 'the queue is full', 'reason': 'TOO_BUSY', 'retryDuration': '0.300s'},
                                 reset=True)
            self.js('isoscope.view.update({ samples: 4 })')
            end = time.monotonic() + base.PATIENCE_S
            while self.gateway.control()['states'] < 4 and time.monotonic() < end:
                time.sleep(0.05)
            self.assertGreaterEqual(self.gateway.control()['states'], 4)
            self.assertEqual(whole, self.gateway.control()['last']['frame']['viewport']['widthPx'])
            self.gateway.control(fail=None)
            self.until(f'isoscope.view.isExact && isoscope.view.stats().width === {whole}')
            self.assertEqual('', self.notice())


class RefiningTest(PageTest):
    QUERY = '?theme=dark'
    FEATURES = ['notes', 'levels', 'refinement', 'unresolved_count']
    CHEAP = {'tiles': 12, 'bytes': 1e6, 'seconds': 0.5}
    COSTLY = {'tiles': 12, 'bytes': 2.1e9, 'seconds': 40}
    STATE = 'document.getElementById("state").textContent'

    def refine(self, **what):
        self.gateway.control(features=self.FEATURES, refine={**self.CHEAP, **what})

    def show(self, text='exact', hash_='#dataset=ball&surface=40'):
        self.open(hash_)
        # The picture begins anew when the page is whole: tiles of the one before do not count.
        self.until('isoscope.view.dataset && isoscope.view.state.withNotes')
        self.until_drawn()
        self.until(f'isoscope.view.isCurrent && {self.STATE}.includes({text!r})')

    def button(self):
        return self.browser.find_element(By.ID, 'draw-exact')

    def tile_shares(self):
        """The share of pixels of each of the 12 tiles that are those of the server."""
        (width, height, rows), (_, _, exact) = self.picture()[:3], self.reference()[:3]
        shares = []
        for index in range(12):
            left, right = (index % 4) * width // 4, (index % 4 + 1) * width // 4
            top, bottom = index // 4 * height // 3, (index // 4 + 1) * height // 3
            shares.append(sum(rows[y][x] == exact[y][x] for y in range(top, bottom) for x in range(left, right))
                          / ((right - left) * (bottom - top)))
        return shares

    def test_tiles_are_the_server_s_pixels_without_a_seam_over_the_coarse_frame_until_all_is_exact(self):
        with size_of(self.browser, 701, 421):
            self.refine(tiles=5)
            self.show('exact 5 of 12')
            of_before = self.gateway.control()['tiles'] - 5
            self.assertEqual([1] * 5 + [0] * 7, self.tile_shares())
            self.assertFalse(self.js('return isoscope.view.isExact'))
            self.assertEqual({'done': 5, 'count': 12}, self.js('return isoscope.view.progress'))
            self.refine(tiles=11)
            self.until(f'{self.STATE} === "exact 11 of 12"')
            self.assertEqual([1] * 11 + [0], self.tile_shares())
            self.refine()
            self.until('isoscope.view.isExact')
            self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
            self.until(f'/^exact · /.test({self.STATE})')
            # A tile is not shown where the whole picture is here before it.
            self.assertEqual((0, 12), (self.js('return isoscope.view.stats().bitmapsOpen'), self.gateway.control()['tiles'] - of_before))

    def test_a_move_ends_the_tiles_of_the_view_before(self):
        self.refine(tiles=5)
        self.show('exact 5 of 12')
        self.drag(80, 30)
        self.refine()
        self.until('isoscope.view.isExact')
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))

    def test_the_pointer_says_where_tiles_come_first_and_the_picture_does_not_begin_anew(self):
        self.refine(tiles=5)
        self.show('exact 5 of 12')
        of_before = self.gateway.control()['tiles'] - 5
        base.ActionChains(self.browser).move_to_element_with_offset(self.browser.find_element(By.ID, 'view'), 150, 80).perform()
        end = time.monotonic() + base.PATIENCE_S
        while min(self.gateway.control()['last']['refinement'].get('focus', {'x': 0, 'y': 0}).values()) <= 0.5:
            self.assertLess(time.monotonic(), end, 'the place is never told')
            time.sleep(0.05)
        self.refine()
        self.until('isoscope.view.isExact')
        self.assertEqual(12, self.gateway.control()['tiles'] - of_before, 'tiles were drawn again')
        self.assertEqual('', self.notice())

    def test_over_a_limit_the_badge_says_the_cost_and_the_button_draws_it_once(self):
        self.refine(**self.COSTLY)
        self.gateway.control(unresolved=37)
        self.show('level 2, 1 sample = 0.9 px')
        self.until('!document.getElementById("exact-offer").hidden')
        self.assertEqual('exact: 2.1 GB, about 40 s', self.browser.find_element(By.ID, 'exact-cost').text)
        self.until('document.getElementById("state").title === "37 blocks of the surface are not resolved at this level."')
        self.assertEqual('', self.notice())
        self.assertEqual({'maxExactBytes': '4000000000', 'maxExactDuration': '10.000s'},
                         {name: value for name, value in self.gateway.control()['last']['refinement'].items() if name.startswith('max')})
        self.button().click()
        self.until('isoscope.view.isExact')
        self.assertFalse(self.button().is_displayed())
        self.assertEqual(1, self.share_of_equal(self.picture(), self.reference()))
        self.drag(80, 30)
        self.until('!document.getElementById("exact-offer").hidden')

    def test_limits_are_settings_that_links_keep_where_they_are_others(self):
        self.refine(**self.COSTLY)
        self.show('level 2')
        self.assertNotIn('exact-limit', self.browser.current_url)
        field = self.browser.find_element(By.ID, 'limit-seconds')
        field.clear()
        field.send_keys('60', Keys.ENTER)
        self.until('isoscope.view.isExact')
        self.until('/exact-limit=60,4/.test(location.hash)')
        self.show('exact ·', '#dataset=ball&surface=40&exact-limit=none,none')
        self.assertEqual(['', ''], self.js('return ["limit-seconds", "limit-gigabytes"].map((id) => document.getElementById(id).value)'))

    def test_on_a_phone_the_offer_is_within_the_picture_with_a_target_for_fingers(self):
        with size_of(self.browser, 390, 780, 2, is_touch=True):
            self.refine(**self.COSTLY)
            self.show('level 2')
            self.until('!document.getElementById("exact-offer").hidden')
            offer, button = (self.browser.find_element(By.ID, name).rect for name in ('exact-offer', 'draw-exact'))
            badge = self.browser.find_element(By.ID, 'state').rect
            self.assertGreaterEqual(offer['x'], 0)
            self.assertLessEqual(offer['x'] + offer['width'], 390)
            self.assertGreaterEqual(button['height'], 44)
            self.assertGreaterEqual(offer['y'], badge['y'] + badge['height'])

    def test_the_menu_of_levels_is_there_with_levels_and_is_undone(self):
        self.refine()
        self.show('exact ·')
        self.assertFalse(self.browser.find_element(By.ID, 'level-row').is_displayed())
        self.gateway.control(levels=2)
        self.show('exact ·')
        self.assertEqual(['finest', 'spacing', '1', '2'], self.js('return [...document.getElementById("level").options].map(({ value }) => value)'))
        choose = 'const menu = document.getElementById("level"); menu.value = arguments[0]; menu.onchange()'
        self.js(choose, '2')
        self.until('isoscope.view.isExact && /level=2/.test(location.hash)')
        self.assertEqual({'level': 2}, self.gateway.control()['last']['frame']['level'])
        self.until_kept()
        self.js(choose, 'spacing')
        self.until('isoscope.view.isExact && /max-spacing=1.1/.test(location.hash)')
        self.until_kept()  # its button can be pressed
        self.js('document.getElementById("undo").click()')
        self.until('isoscope.view.isExact && isoscope.view.state.level.level === 2')


class SmoothRefiningTest(RefiningTest):
    """WebGL2 by the processor: tiles are painted into its texture."""
    QUERY = '?theme=dark&renderer=webgl2'


class SmoothTest(PixelTest):
    """WebGL2 by the processor: the same shaders, slowly."""
    QUERY = '?theme=dark&renderer=webgl2'

    def test_a_moving_frame_is_enlarged_without_blocks(self):
        with size_of(self.browser, 700, 420):
            self.open_and_wait('#dataset=ball&surface=40')
            self.assertEqual('webgl2', self.js('return isoscope.view.stats().renderer'))
            # A frame of 8 x 6 pixels, of which every second column is white.
            self.js('''const small = document.createElement('canvas'); small.width = 8; small.height = 6;
                const context = small.getContext('2d'); context.fillStyle = '#000'; context.fillRect(0, 0, 8, 6);
                context.fillStyle = '#fff'; for (let x = 0; x < 8; x += 2) context.fillRect(x, 0, 1, 6);
                return createImageBitmap(small).then((bitmap) => { const { picture } = isoscope.view.loop;
                  picture.show(bitmap, { width: 8, height: 6, camera: isoscope.view.camera, grid: null, isExact: false, background: [0, 0, 0] }); });''')
            width, height, rows = self.picture()
            middle = [pixel[0] for pixel in rows[height // 2][2 * width // 5:3 * width // 5]]
            steps = [abs(a - b) for a, b in zip(middle, middle[1:])]
            self.assertGreater(max(middle) - min(middle), 60)
            self.assertLess(max(steps), 40, 'pixels of the small frame have edges')


class RangeTest(PageTest):
    RANGE = 'isoscope.view.state.surfaces[0].colorBy.range'

    def test_colours_take_the_range_of_the_step_and_that_of_all_steps(self):
        self.open_and_wait('#dataset=flow&surface=40&step=1&color-by=velocity:x:viridis')
        self.until('document.getElementById("range-step").offsetHeight > 0')
        self.gateway.control(reset=True)
        self.browser.find_element(By.ID, 'range-step').click()
        # The mock counts samples from 0 to 100 at each step; over all steps they are -2 to 50.
        self.until(f'isoscope.view.isExact && {self.RANGE}')
        self.assertEqual({'min': 0, 'max': 50}, self.js(f'return {self.RANGE}'))
        self.assertIn('/v1/datasets/flow/histogram?bins=4096&field=velocity&component=x&step=1', self.gateway.control()['targets'])
        self.browser.find_element(By.ID, 'range-all').click()
        self.until(f'isoscope.view.isExact && {self.RANGE}.min === -2')
        self.assertEqual({'min': -2, 'max': 50}, self.js(f'return {self.RANGE}'))
        self.until('document.getElementById("range-min").value === "-2" && document.getElementById("range-max").value === "50"')

    def test_another_field_keeps_the_material_of_the_first_look(self):
        self.open_and_wait('#dataset=flow')
        material = self.js('return isoscope.view.state.surfaces[0].material')
        self.assertTrue(material)
        self.choose('field', 'velocity:x')
        self.until('isoscope.view.isExact && isoscope.view.state.selection?.field === "velocity"')
        self.assertEqual(material, self.js('return isoscope.view.state.surfaces[0].material'))
        self.until('/&material=soft/.test(location.hash)')

    def test_a_position_has_no_steps(self):
        self.open_and_wait('#dataset=flow&surface=40&step=1&color-by=z:viridis')
        self.until('document.getElementById("map").offsetHeight > 0')
        self.assertEqual(0, self.js('return document.getElementById("range-step").offsetHeight'))

    def test_a_step_that_a_field_lacks_has_no_range(self):
        self.open_and_wait('#dataset=flow&surface=40&step=5&color-by=velocity:x:viridis')
        self.until('document.getElementById("range-step").offsetHeight > 0')
        self.assertTrue(self.js('return document.getElementById("range-step").disabled'))


class Downloads:
    """What tests of downloads share: a folder of their own, the fields of the dialog, and waiting for a file."""

    def setUp(self):
        super().setUp()
        self.saved = tempfile.mkdtemp(prefix='isoscope-saved-')
        self.addCleanup(shutil.rmtree, self.saved, ignore_errors=True)
        self.browser.execute_cdp_cmd('Browser.setDownloadBehavior', {'behavior': 'allow', 'downloadPath': self.saved})

    def by_id(self, name):
        return self.browser.find_element(By.ID, name)

    def open_dialog(self):
        self.by_id('save').click()
        self.until('document.getElementById("dialog").open')

    def fill(self, **values):
        """Fields by their id, with '_' for '-': a text, or whether a box is ticked."""
        for name, value in values.items():
            self.js("""const [id, value] = arguments; const field = document.getElementById(id);
                if (field.type === 'checkbox') { field.checked = value; } else { field.value = value; }
                field.dispatchEvent(new Event('input'));""", name.replace('_', '-'), value)

    def file(self, name):
        """The bytes of a download once it is whole. The file goes, so that the next one may have its name."""
        path = os.path.join(self.saved, name)
        end = base.time.monotonic() + base.PATIENCE_S
        while not os.path.exists(path) or any(one.endswith('.crdownload') for one in os.listdir(self.saved)):
            self.assertLess(base.time.monotonic(), end, f'{name} never came; there are {os.listdir(self.saved)}; '
                            f'{[self.by_id(note).text for note in ("save-note", "film-note", "mesh-note")]}')
            base.time.sleep(0.02)
        with open(path, 'rb') as file:
            data = file.read()
        os.remove(path)
        return data

    def last_render(self):
        """The parameters of the last picture that was asked for."""
        address = [one for one in self.gateway.control()['targets'] if '/render' in one][-1]
        return dict(urllib.parse.parse_qsl(urllib.parse.urlsplit(address).query, keep_blank_values=True))

    def played(self, film, kind):
        """What the browser's own decoder finds: the count of frames, their size, and of each a channel of its first pixel and all pixels."""
        self.browser.set_script_timeout(base.PATIENCE_S)
        count, width, height, values, pixels = self.browser.execute_async_script("""const [text, type, done] = arguments;
            (async () => {
              const decoder = new ImageDecoder({ data: Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)), type });
              await decoder.tracks.ready;
              const { frameCount } = decoder.tracks.selectedTrack;
              const values = [], pixels = [];
              let size = [0, 0];
              for (let frameIndex = 0; frameIndex < frameCount; ++frameIndex) {
                const { image } = await decoder.decode({ frameIndex });
                size = [image.displayWidth, image.displayHeight];
                const canvas = new OffscreenCanvas(...size).getContext('2d');
                canvas.drawImage(image, 0, 0);
                values.push(canvas.getImageData(0, 0, 1, 1).data[0]);
                pixels.push([...canvas.getImageData(0, 0, ...size).data].join());
                image.close();
              }
              done([frameCount, ...size, values, pixels]);
            })().catch((error) => done([String(error), 0, 0, [], []]));""", base.base64.b64encode(film).decode(), kind)
        return count, width, height, values, pixels

    @staticmethod
    def chunks(png):
        """The types of the chunks of a PNG."""
        at, types = 8, []
        while at < len(png):
            types.append(png[at + 4:at + 8].decode())
            at += 12 + struct.unpack('>I', png[at:at + 4])[0]
        return types


class DownloadTest(Downloads, PageTest):
    def test_a_picture_is_asked_for_with_what_is_drawn_over_it_and_its_record(self):
        self.open_and_wait('#dataset=ball&surface=40')
        self.open_dialog()
        self.assertTrue(self.js('return document.getElementById("draw-legend").disabled'), 'a legend of nothing')
        self.js('isoscope.view.update({ surfaces: [{ isovalue: 40, colorBy: { quantity: "QUANTITY_POSITION_Z" } }] })')
        self.until('!document.getElementById("draw-legend").disabled')
        self.fill(width=64, height=48, draw_axes=True, draw_scale_bar=True, draw_legend=True, caption='at {isovalue} & more')
        command = self.by_id('command').text
        for words in ('--axes', '--scale-bar', '--legend', "--caption 'at {isovalue} & more'"):
            self.assertIn(words, command)
        self.by_id('save-png').click()
        self.assertEqual((64, 48), base.decode_png(self.file('ball.png'))[:2])
        self.assertEqual({'axes': '', 'scale-bar': '', 'legend': '', 'caption': 'at {isovalue} & more', 'record': ''}, self.last_render())
        self.fill(draw_axes=False, draw_scale_bar=False, draw_legend=False, caption='', record=False)
        self.by_id('save-png').click()
        self.file('ball.png')
        self.assertEqual({}, self.last_render())

    def test_each_kind_of_mesh_has_its_file_and_the_surfaces_of_the_view(self):
        self.open_and_wait('#dataset=ball&surface=40:1,0,0:0.5&clip-plane=1,0,0,20')
        self.open_dialog()
        for name in ('stl', 'ply', 'obj', 'vtp', 'glb'):
            self.fill(mesh_format=name)
            self.by_id('save-mesh').click()
            self.assertEqual(f'a mesh.{name}'.encode(), self.file(f'ball.{name}'))
            self.until('!document.getElementById("save-mesh").hidden')
            color = '' if name == 'stl' else ':1,0,0'
            self.assertIn(f'/v1/datasets/ball/mesh.{name}?surface=40{color}&clip-plane=1,0,0,20', self.gateway.control()['targets'])

    def test_a_turn_says_which_frame_it_draws_and_keeps_distance_and_ranges(self):
        self.open_and_wait('#dataset=ball&surface=40&color-by=z')
        camera = self.js('return isoscope.view.getState().camera')
        self.js('isoscope.view.update({ surfaces: [{ ...isoscope.view.state.surfaces[0], colorBy: { quantity: "QUANTITY_POSITION_Z",'
                ' range: { source: "SOURCE_VISIBLE" } } }] })')
        self.until_exact()
        self.open_dialog()
        self.fill(width=40, height=30, film_frames=6)
        self.assertIn('6 frames of 40 × 30, 0.5 s', self.by_id('film-hint').text)
        self.js("""window.told = []; new MutationObserver(() => told.push(document.getElementById('film-note').textContent))
            .observe(document.getElementById('film-note'), { childList: true, characterData: true, subtree: true });""")
        self.gateway.control(reset=True)
        self.by_id('save-film').click()
        film = self.file('ball.apng')
        self.assertEqual(6, self.chunks(film).count('fcTL'))
        self.assertEqual((6, 40, 30), self.played(film, 'image/png')[:3])
        self.until('!document.getElementById("save-film").hidden')
        self.assertEqual([f'frame {i} of 6' for i in range(1, 7)], self.js('return told')[:-1][-6:])
        renders = self.gateway.control()['renders']
        eyes = [tuple(one['camera']['eye'][axis] - camera['target'][axis] for axis in 'xyz') for one in renders]
        self.assertEqual(6, len({tuple(round(value, 6) for value in eye) for eye in eyes}))
        for eye in eyes:
            self.assertAlmostEqual(base.math.hypot(*eyes[0]), base.math.hypot(*eye))
        self.assertEqual([{'source': 'SOURCE_VISIBLE'}] + 5 * [{'min': 0.123456, 'max': 7.98765}],
                         [one['surfaces'][0]['colorBy']['range'] for one in renders])

    def test_a_browser_plays_a_film_of_webps_where_the_gateway_has_them(self):
        self.gateway.control(hasWebp=True)
        self.open_and_wait('#dataset=ball&surface=40')
        self.open_dialog()
        self.until('document.getElementById("film-format").value === "webp"')
        self.fill(width=41, height=31, film_frames=5, draw_axes=True)
        self.by_id('save-film').click()
        self.assertEqual((5, 41, 31, [0, 1, 2, 3, 4]), self.played(self.file('ball.webp'), 'image/webp')[:4])
        targets = [one for one in self.gateway.control()['targets'] if 'format=webp' in one]
        self.assertEqual(5, len({urllib.parse.parse_qs(one)['eye'][0] for one in targets}))
        self.assertTrue(all(one.endswith('&axes=') for one in targets))

    def test_a_film_of_steps_shows_every_second_one(self):
        self.open_and_wait('#dataset=flow&surface=40&step=1')
        self.until('document.getElementById("step").max === "5"')
        self.open_dialog()
        self.fill(width=40, height=30, film_kind='steps', film_stride=2)
        self.assertIn('3 frames', self.by_id('film-hint').text)
        self.gateway.control(reset=True)
        self.by_id('save-film').click()
        self.assertEqual(3, self.chunks(self.file('flow.apng')).count('fcTL'))
        self.assertEqual([0, 2, 4], [one['selection']['timeStep'] for one in self.gateway.control()['renders']])
        # A dataset without steps has no film of them.
        self.open_and_wait('#dataset=ball&surface=40')
        self.open_dialog()
        self.assertTrue(self.js('const { options, value } = document.getElementById("film-kind"); return options[1].disabled && value === "turn"'))

    def test_the_command_is_that_of_the_picture_the_film_or_the_mesh(self):
        self.open_and_wait('#dataset=flow&surface=40:1,0,0&step=1')
        self.until('document.getElementById("step").max === "5"')
        self.open_dialog()
        self.assertIn('--output picture.png', self.by_id('command').text)
        self.fill(width=40, height=30, film_frames=6, film_rate=10, draw_axes=True, mesh_format='ply', command_of='film')
        for words in ('isoscope render', '--step 1', '--axes', '--samples 4', '--width 40', '--repeat 6', '--orbit 60', '--fps 10', '--output film.apng'):
            self.assertIn(words, self.by_id('command').text)
        self.fill(film_kind='steps', film_stride=2)
        self.assertIn('--step 0:4:2', self.by_id('command').text)
        self.assertIn("--caption '{time}'", self.by_id('command').text)
        self.assertIn('the time as caption', self.by_id('film-hint').text)
        self.fill(film_rate=0)
        self.assertEqual('A film has 0.1 to 120 frames a second.', self.by_id('command-hint').text)
        self.assertFalse(self.by_id('copy-command').is_enabled())
        self.fill(command_of='mesh')
        self.assertEqual(['isoscope export --server HOST:50051', '--dataset flow', '--step 1', '--surface 40:1,0,0', '--output mesh.ply'],
                         self.by_id('command').text.split(' \\\n  '))
        self.assertIn('writes this mesh', self.by_id('command-hint').text)
        self.assertTrue(self.by_id('copy-command').is_enabled())

    def test_a_film_that_the_page_could_not_hold_can_t_be_begun_and_says_why(self):
        self.open_and_wait('#dataset=ball&surface=40')
        self.open_dialog()
        self.fill(width=7680, height=4320)
        self.assertIn('2389 million pixels, and this page holds 600 million', self.by_id('film-hint').text)
        self.assertFalse(self.by_id('save-film').is_enabled())
        self.fill(width=640, height=360)
        self.assertTrue(self.by_id('save-film').is_enabled())

    def test_a_film_is_cancelled_with_the_keyboard_alone_and_asks_for_nothing_more(self):
        self.open_and_wait('#dataset=ball&surface=40')
        self.open_dialog()
        self.fill(width=160, height=120, film_frames=2000)
        self.js('document.getElementById("save-film").focus()')
        base.ActionChains(self.browser).send_keys(Keys.ENTER).perform()
        self.until('/^frame ([3-9]|[0-9]{2,}) of 2000/.test(document.getElementById("film-note").textContent)')
        self.assertEqual('Cancel: Download film', self.js('return document.activeElement.getAttribute("aria-label")'))
        self.assertTrue(self.js('return !document.getElementById("film-progress").hidden'))
        base.ActionChains(self.browser).send_keys(Keys.ENTER).perform()
        self.until('document.getElementById("film-note").textContent === "Cancelled." && document.getElementById("film-progress").hidden')
        self.assertEqual('save-film', self.js('return document.activeElement.id'))
        self.assertLess(self.until_still(lambda: len(self.gateway.control()['renders'])), 2000)
        self.assertEqual([], os.listdir(self.saved))

    def test_a_film_goes_on_while_the_dialog_is_closed_and_its_end_is_said_in_the_page(self):
        self.open_and_wait('#dataset=ball&surface=40')
        self.open_dialog()
        self.fill(width=40, height=30, film_frames=30)
        self.js('''window.told = []; const toast = document.getElementById('toast');
            new MutationObserver(() => { if (!toast.hidden) told.push(toast.textContent); }).observe(toast, { childList: true, attributes: true });
            document.getElementById('save-film').click(); document.getElementById('dialog').close();''')
        self.file('ball.apng')
        self.until('told.some((text) => /^Downloaded ball.apng/.test(text))')

    def test_the_dialog_has_names_and_on_a_phone_targets_for_fingers_within_its_width(self):
        with size_of(self.browser, 390, 844, is_touch=True):
            self.open_and_wait('#dataset=flow&surface=40&step=1')
            self.open_dialog()
            controls = self.js("""return [...document.querySelectorAll('#dialog :is(button, select, input)')].filter((e) => e.offsetParent !== null)
                .map((e) => { const box = (e.closest('.switch') ?? e).getBoundingClientRect();
                  return [e.id || e.textContent, e.getAttribute('aria-label') || e.labels?.[0]?.textContent || e.textContent, box.height, box.left, box.right]; })""")
            self.assertGreater(len(controls), 20)
            for name, label, height, left, right in controls:
                with self.subTest(name):
                    self.assertTrue(label.strip())
                    self.assertGreaterEqual(height, 44)
                    self.assertTrue(left >= 0 and right <= 390, f'{left} to {right}')
            self.assertFalse(self.js('const { scrollWidth, clientWidth } = document.getElementById("dialog"); return scrollWidth > clientWidth'))


class RealDownloadTest(Downloads, base.RealPageTest):
    def test_a_picture_a_mesh_and_a_film_of_a_real_server(self):
        self.browser.get('about:blank')
        self.browser.get(f'{self.page}&max-side=240')
        self.until('isoscope.view.isExact')
        self.js('isoscope.view.update({ surfaces: [{ ...isoscope.view.state.surfaces[0], colorBy: { quantity: "QUANTITY_POSITION_Z" } }] })')
        self.until('isoscope.view.isExact && isoscope.view.state.surfaces[0].colorBy')
        name = self.js('return isoscope.view.state.dataset')
        self.open_dialog()
        self.fill(width=360, height=270, save_samples=1, draw_axes=True, draw_scale_bar=True, draw_legend=True, caption='at {isovalue}')
        self.by_id('save-png').click()
        picture = self.file(f'{name}.png')
        drawn = base.decode_png(picture)

        def run(*flags):
            subprocess.run([self.program, *flags], check=True, cwd=self.folder, env=self.environment,
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

        def run_command(*flags):
            run(*shlex.split(self.by_id('command').text.replace('\\\n', ' '))[1:], *flags)

        def made(file):
            with open(os.path.join(self.folder, file), 'rb') as opened:
                return opened.read()
        # The command draws the same; the record makes what was drawn over.
        run_command('--renderer', 'cpu')
        self.assertEqual(1, self.share_of_equal(drawn, base.decode_png(made('picture.png'))))
        with open(os.path.join(self.folder, 'saved.png'), 'wb') as saved:
            saved.write(picture)
        run('render', self.volume, '--like', 'saved.png', '--output', 'again.png', '--renderer', 'cpu')
        # The legend is at the right side.
        self.fill(draw_legend=False, draw_axes=False, draw_scale_bar=False, caption='', record=False)
        self.by_id('save-png').click()
        plain = base.decode_png(self.file(f'{name}.png'))
        self.assertEqual(1, self.share_of_equal(plain, base.decode_png(made('again.png'))))
        changed = [x for y in range(270) for x in range(300, 360) if drawn[2][y][x] != plain[2][y][x]]
        self.assertGreater(len(changed), 500)

        self.fill(mesh_format='stl')
        self.by_id('save-mesh').click()
        mesh = self.file(f'{name}.stl')
        count, = struct.unpack('<I', mesh[80:84])
        self.assertGreater(count, 1000)
        self.assertEqual(84 + 50 * count, len(mesh))
        self.fill(command_of='mesh')
        run_command()
        self.assertEqual(count, struct.unpack('<I', made('mesh.stl')[80:84])[0])
        self.fill(command_of='picture')

        self.fill(width=90, height=60, film_frames=5, film_rate=10, film_format='apng')
        self.by_id('save-film').click()
        film = self.file(f'{name}.apng')
        self.assertEqual(5, self.chunks(film).count('fcTL'))
        self.assertGreaterEqual(self.chunks(film).count('fdAT'), 4)
        run_command('--renderer', 'cpu')
        self.assertEqual(1, self.share_of_equal(base.decode_png(film), base.decode_png(made('picture.png'))))
        self.fill(command_of='film')
        run_command('--renderer', 'cpu')
        self.assertEqual(film, made('film.apng'))
        played = self.played(film, 'image/png')
        self.assertEqual((5, 90, 60, 5), (*played[:3], len(set(played[4]))))
        if self.js('return [...document.getElementById("film-format").options].some(({ value }) => value === "webp")'):
            self.until('!document.getElementById("save-film").hidden')
            self.fill(film_format='webp')
            self.by_id('save-film').click()
            self.assertEqual(played, self.played(self.file(f'{name}.webp'), 'image/webp'))


class RealDoorTest(base.RealPageTest):
    def test_a_wrong_token_meets_the_door_and_the_right_one_the_picture(self):
        address = urllib.parse.urlsplit(self.page)
        query = dict(urllib.parse.parse_qsl(address.query))
        self.browser.get('about:blank')
        self.browser.get(f'{address.scheme}://{address.netloc}/?max-side=420&token=old#dataset={query["dataset"]}&surface=90')
        self.until('!document.getElementById("door").hidden')
        self.assertEqual('', self.notice())
        self.browser.find_element(By.ID, 'door-token').send_keys(query['token'], Keys.ENTER)
        self.until('isoscope.view.isExact && document.getElementById("door").hidden')
        self.assertEqual(90, self.js('return isoscope.view.state.surfaces[0].isovalue'))


if __name__ == '__main__':
    if base.missing():
        skips.skip_program('browser', 'the page is tested in one, and these are missing: ' + ', '.join(base.missing()))
    base.main()
