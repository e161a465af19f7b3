// SPDX-License-Identifier: Apache-2.0
// Palette, opened by Ctrl-K: goes to a page, agent, node or tunable by name.

import { useEffect, useId, useMemo, useRef, useState, type KeyboardEvent as PressedKey } from "react";
import { PAGES, type Address } from "./address";
import { go } from "./navigation";
import css from "./palette.module.css";
import shared from "./shared.module.css";
import { useCollection } from "./store";
import { texts } from "./texts";

const words = texts.palette;
const MOST_SHOWN = 12;
/** A page with its own search opens without a search text. */
const NOTHING: Partial<Address> = { node: "", search: "" };

interface Place {
  kind: keyof typeof words.kinds;
  name: string;
  /** Distinguishes it from others of the same name. */
  where: string;
  address: Partial<Address>;
}

export function Palette() {
  const dialog = useRef<HTMLDialogElement>(null);
  const [isOpen, setOpen] = useState(false);
  useEffect(() => {
    const pressed = (event: KeyboardEvent): void => {
      if (event.key.toLowerCase() !== "k" || !(event.ctrlKey || event.metaKey) || event.altKey || event.shiftKey) return;
      event.preventDefault();
      if (document.querySelector("dialog[open]") !== null) return;
      dialog.current?.showModal();
      setOpen(true);
    };
    window.addEventListener("keydown", pressed);
    return () => window.removeEventListener("keydown", pressed);
  }, []);
  return (
    <dialog className={css.palette} ref={dialog} aria-label={words.title} onClose={() => setOpen(false)}>
      {isOpen && <Search close={() => dialog.current?.close()} />}
    </dialog>
  );
}

function Search({ close }: { close: () => void }) {
  const places = usePlaces();
  const [text, setText] = useState("");
  const [chosen, setChosen] = useState(0);
  const list = useId();
  const found = useMemo(() => search(places, text), [places, text]);
  const at = Math.min(chosen, found.length - 1);
  useEffect(() => document.getElementById(`${list}-${at}`)?.scrollIntoView({ block: "nearest" }), [at, found]);
  const goTo = (place: Place): void => {
    close();
    go({ ...NOTHING, ...place.address }, true);
  };
  const pressed = (event: PressedKey): void => {
    const place = found[at];
    if (event.key === "Enter" && place) goTo(place);
    else if (event.key === "ArrowDown") setChosen((at + 1) % found.length);
    else if (event.key === "ArrowUp") setChosen((at + found.length - 1) % found.length);
    else return;
    event.preventDefault();
  };
  return (
    <>
      <input
        type="text"
        role="combobox"
        autoFocus
        aria-label={words.title}
        placeholder={words.title}
        aria-expanded={found.length > 0}
        aria-controls={list}
        aria-activedescendant={found.length > 0 ? `${list}-${at}` : undefined}
        value={text}
        onChange={(event) => {
          setText(event.target.value);
          setChosen(0);
        }}
        onKeyDown={pressed}
      />
      <ul role="listbox" id={list} aria-label={words.title}>
        {found.map((place, index) => (
          <li key={index} id={`${list}-${index}`} role="option" aria-selected={index === at} onClick={() => goTo(place)}>
            {place.name} <span className={shared.faint}>{[words.kinds[place.kind], place.where].filter(Boolean).join(" · ")}</span>
          </li>
        ))}
      </ul>
      {found.length === 0 && <p className={shared.faint}>{words.none}</p>}
    </>
  );
}

/** Everything that has a name: pages first. */
function usePlaces(): Place[] {
  const agents = useCollection("agents");
  const trees = useCollection("trees");
  const tunables = useCollection("tunables");
  return useMemo(() => {
    const titles = new Map(agents.map(([name, one]) => [name, one.title || name]));
    const title = (name: string): string => titles.get(name) ?? name;
    const pages = PAGES.map((page): Place => ({ kind: "page", name: texts.pages[page], where: "", address: { page } }));
    const ofAgents = agents.map(([agent]): Place => {
      return { kind: "agent", name: title(agent), where: agent, address: { page: "live", agent } };
    });
    const values = tunables.map(([, { name, agent, key }]): Place => {
      return { kind: "tunable", name: key, where: title(agent), address: { page: "tune", search: name } };
    });
    const nodes = trees.flatMap(([, { agent, nodes }]) =>
      nodes.map(({ name, kind, path }): Place => {
        return { kind: "node", name: name || kind, where: `${title(agent)} · ${path}`, address: { page: "live", agent, node: path } };
      }),
    );
    return [...pages, ...ofAgents, ...values, ...nodes];
  }, [agents, trees, tunables]);
}

/** The first places that match all words of a text; names that begin with the text come first. */
function search(places: readonly Place[], text: string): Place[] {
  const wanted = text.toLowerCase().split(/\s+/).filter(Boolean);
  const isFound = ({ name, where }: Place): boolean => {
    const known = `${name} ${where}`.toLowerCase();
    return wanted.every((word) => known.includes(word));
  };
  const isFirst = ({ name }: Place): number => (name.toLowerCase().startsWith(wanted[0] ?? "") ? 0 : 1);
  return places.filter(isFound).sort((one, other) => isFirst(one) - isFirst(other)).slice(0, MOST_SHOWN);
}
