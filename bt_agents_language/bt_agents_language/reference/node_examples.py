# SPDX-License-Identifier: Apache-2.0
"""One example for every word of the tree language: part of an agent file, ready to be copied."""

from __future__ import annotations

from collections.abc import Mapping

EXAMPLES: Mapping[str, str] = {
    "sequence": """\
tree:
  sequence:
    - say: Hello.
    - drive: check-in desk
""",
    "selector": """\
tree:
  selector:
    - ask: Shall I carry your bag?
    - say: Nobody answered. I wait over there.
""",
    "parallel": """\
tree:
  parallel:
    succeed_on: all
    children:
      - show: Follow me
      - drive: check-in desk
""",
    "choose": """\
tree:
  choose:
    children:
      - name: in a bad mood
        when: scene.mood < 2
        show: Follow me, please.
      - name: regular guest
        when: scene.familiarity >= 4
        say: Where to?
    otherwise:
      say: Hello. I carry your luggage. Where to?
""",
    "random": """\
tree:
  random:
    - say: Hello.
      weight: 3
    - say: Good day to you.
""",
    "check": """\
tree:
  selector:
    - sequence:
        - check: scene.familiarity >= 4
        - say: You know how this works.
    - say: I will show you how this works.
""",
    "set": """\
tree:
  sequence:
    - set: {place: gate 12, tries: 3}
    - say: We go to ${place}.
    - drive: ${place}
      retry: ${tries}
""",
    "wait": """\
tree:
  sequence:
    - say: Let me think.
    - wait: 1.5 s
    - say: This way.
""",
    "wait_for": """\
tree:
  sequence:
    - wait_for: live.person
      timeout: 1 min
    - wait_for: {condition: live.mood >= 4, for: 2 s}
      timeout: 1 min
    - wait_for: {topic: buttons/confirm, type: std_msgs/msg/Bool, until: msg.data}
      timeout: 10 s
""",
    "action": """\
tree:
  sequence:
    - action:
        name: ask
        type: bt_agents_interfaces/action/Ask
        goal: {text: "Where to?", wait_s: 10.0}
        outputs: {place: answer}
        succeed_when: result.answer != ''
    - say: To ${place}.
""",
    "service": """\
tree:
  service:
    name: set_light
    type: bt_agents_interfaces/srv/SetLight
    request: {colour: green, blink: true}
    succeed_when: result.accepted
""",
    "publish": """\
tree:
  publish: {topic: sound, type: std_msgs/msg/String, message: {data: chirp}}
""",
    "log": """\
tree:
  sequence:
    - log: The mood is ${live.mood}.
    - log: {message: Nobody is here., level: warning}
      when: not live.person
""",
    "give_feedback": """\
tree:
  sequence:
    - ask: {text: "Was this good?", choices: ["yes", "no"]}
    - give_feedback: {kind: positive, reason: the person said so}
      when: answer == 'yes'
""",
    "subtree": """\
tree:
  subtree: greet
  with: {who: Ms. Miller}
subtrees:
  greet:
    inputs: {who: text}
    tree:
      say: Good morning, ${who}.
""",
    "when": """\
tree:
  sequence:
    - say: Hello. I carry your luggage.
      when: scene.familiarity < 3
    - drive: check-in desk
""",
    "once": """\
tree:
  repeat: 3
  sequence:
    - say: I play a sound whenever you press the button.
      once: true
    - wait_for: {topic: buttons/confirm, type: std_msgs/msg/Bool, until: msg.data}
      timeout: 10 s
    - sound: chirp
""",
    "cooldown": """\
tree:
  repeat: {until: not live.person, pause: 1 s}
  sequence:
    - say: I am still here.
      cooldown: 30 s
    - wait: 1 s
""",
    "succeed": """\
tree:
  sequence:
    - ask: Would you like some music?
      succeed: true
    - drive: check-in desk
""",
    "fail": """\
tree:
  selector:
    - say: I look for somebody who can help.
      fail: true
    - drive: help desk
""",
    "while": """\
tree:
  while: live.person
  sequence:
    - say: Follow me.
    - drive: check-in desk
""",
    "on_failure": """\
tree:
  drive: check-in desk
  on_failure: {say: I could not get through. A colleague will help you.}
""",
    "retry": """\
tree:
  ask: Where to?
  retry: {attempts: 3, pause: 2 s}
""",
    "repeat": """\
tree:
  repeat: {times: 10, until: live.mood >= 4, pause: 5 s}
  say: Smile, please.
""",
    "timeout": """\
tree:
  drive: check-in desk
  timeout: 5 min
""",
    "invert": """\
tree:
  sequence:
    - check: scene.person
      invert: true
    - drive: charging station
""",
    "name": """\
tree:
  sequence:
    - name: greeting
      say: Hello.
""",
    "with": """\
tree:
  subtree: greet
  with: {who: Ms. Miller}
subtrees:
  greet:
    inputs: {who: text}
    tree:
      say: Good morning, ${who}.
""",
    "outputs": """\
tree:
  sequence:
    - ask: Where to?
      outputs: {place: answer}
    - drive: ${place}
""",
    "weight": """\
tree:
  random:
    - say: Hello.
      weight: 3
    - say: Good day to you.
      weight: 1
""",
}
"""Example by node key, modifier or other key beside a node."""

TEXTS: Mapping[str, str] = {
    "say": "Hello.",
    "ask": "Shall we go?",
    "show": "Follow me",
    "drive": "check-in desk",
    "light": "green",
    "sound": "chirp",
}
"""What the text of a skill is in its example, by the usual names of skills."""
