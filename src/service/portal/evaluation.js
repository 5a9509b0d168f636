// A model evaluated by the service: what is asked, asked again only where it is another question, and as a file.
import { ask, save } from "./api.js";

/** Answers that are kept, so that a slider that goes back need not ask again. */
const KEPT = 12;

/** Where the model of a job is evaluated. */
export function evaluations(job) {
  return `${job.links.self}/evaluations`;
}

export class Evaluation {
  constructor(job) {
    this.path = evaluations(job);
    this.answers = new Map();
  }

  /** What is known already of a question. */
  known(question) {
    return this.answers.get(JSON.stringify(question)) ?? null;
  }

  /** The answer to a question; `onwait(problem, seconds)` while the service is busy. Ends with `signal`. */
  async answer(question, signal, onwait) {
    const name = JSON.stringify(question);
    if (!this.answers.has(name)) {
      const made = await (await ask(this.path, { json: question, signal, mayRepeat: true, onwait })).json();
      this.answers.set(name, made);
      if (this.answers.size > KEPT) this.answers.delete(this.answers.keys().next().value);
    }
    return this.answers.get(name);
  }

  /** The same as a file of another form. */
  save(question, format, filename) {
    return save(this.path, filename, null, { json: { ...question, format }, mayRepeat: true });
  }
}
